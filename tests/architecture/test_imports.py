"""The import laws hold, and each of them bites: a little house in which each is broken once is refused."""

import os
import re
import subprocess
import sys
import tomllib
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any, Final

import grimp
import pytest

ROOT: Final = Path(__file__).parents[2]
PACKAGES: Final = ("hardcore", "core", "postmortem", "frontend")

# Rooms of the plan that a later part builds. A room leaves this list when it is built, and none comes in.
NOT_BUILT_YET: Final[frozenset[str]] = frozenset()

# Contract, importer, what it imports although it must not.
BREACHES: Final = (
    ("floors", "hardcore.host.processes", "hardcore.sentinel.verdict"),
    ("floors", "hardcore.sentinel.verdict", "hardcore.recovery.plan"),
    ("floors", "hardcore.snapshot.writer", "hardcore.control.server"),
    ("floors", "hardcore.executor", "hardcore.crisis.app"),
    ("floors", "hardcore.model.phases", "hardcore.settings"),
    ("floors", "hardcore.runtime", "hardcore.cli"),
    ("pure-rooms", "hardcore.model.actions", "os"),
    ("pure-rooms", "hardcore.settings", "pathlib"),
    ("pure-rooms", "hardcore.recovery.budget", "time"),
    ("pure-rooms", "hardcore.sentinel.witnesses.beats", "asyncio"),
    ("pure-rooms", "hardcore.snapshot.recipe", "subprocess"),
    ("pure-rooms", "hardcore.crisis.routing", "socket"),
    ("pure-rooms", "hardcore.crisis.holding", "random"),
    ("pure-rooms", "hardcore.crisis.lifeline", "logging"),
    ("pure-rooms", "hardcore.crisis.face", "signal"),
    ("pure-rooms", "hardcore.control.protocol", "threading"),
    ("pure-rooms", "core.ledger.money", "sqlalchemy"),
    ("pure-rooms", "postmortem.incident", "uuid"),
    ("guarded", "core.service", "hardcore.model.phases"),
    ("guarded", "core.web.app", "postmortem.archive"),
    ("investigators", "postmortem.archive", "hardcore.host.processes"),
    ("investigators", "postmortem.web", "core.service"),
    ("guard", "hardcore.cli", "core.service"),
    ("paper", "frontend.render", "hardcore.settings"),
    ("bridges", "hardcore.snapshot.collectors", "postmortem.bundle"),
    ("bridges", "hardcore.executor", "postmortem.archive"),
    ("paper-bridges", "hardcore.crisis.proxy", "frontend.render"),
    ("paper-bridges", "core.service", "frontend.catalogue"),
    ("paper-bridges", "hardcore.executor", "frontend.catalogue_reports"),
    ("database", "hardcore.host.files", "sqlite3"),
    ("database", "hardcore.crisis.pages", "starlette"),
    ("database", "frontend.catalogue", "sqlalchemy"),
    ("sentinel-process", "hardcore.control.server", "websockets"),
    ("gateway-process", "hardcore.crisis.health", "uvicorn"),
)
# Imports over the named bridges, which the same little house makes lawfully.
BRIDGES: Final = (
    ("hardcore.snapshot.writer", "postmortem.bundle"),
    ("hardcore.court_room", "postmortem.dead_letters"),
    ("hardcore.looking_back", "postmortem.cli"),
    ("postmortem.cli", "sqlalchemy"),
    ("hardcore.crisis.pages", "frontend.render"),
    ("frontend.render", "jinja2"),
    ("hardcore.crisis.pages", "frontend.catalogue_gateway"),
    ("postmortem.reports.html", "frontend.catalogue_reports"),
    ("postmortem.reports.html", "frontend.render"),
    ("postmortem.web", "frontend.render"),
    ("core.web.app", "frontend.render"),
    ("hardcore.stopping", "frontend.catalogue"),
    ("hardcore.alerting.wording", "frontend.catalogue_alerts"),
    ("core.web.app", "starlette"),
)


def _config() -> dict[str, Any]:
    settings: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())
    linter: dict[str, Any] = settings["tool"]["importlinter"]
    return linter


def _contracts() -> dict[str, dict[str, Any]]:
    return {contract["id"]: contract for contract in _config()["contracts"]}


def _build_house(place: Path, imports: tuple[tuple[str, str], ...]) -> None:
    """Lay the four packages with one file per room, holding the given imports."""
    rooms: dict[str, list[str]] = {package: [] for package in PACKAGES}
    ours = {name for pair in imports for name in pair if name.split(".")[0] in PACKAGES}
    for room in ours:
        parts = room.split(".")
        for depth in range(1, len(parts) + 1):
            rooms.setdefault(".".join(parts[:depth]), [])
    for importer, imported in imports:
        rooms[importer].append(imported)
    for room, imported_names in rooms.items():
        is_package = any(other.startswith(room + ".") for other in rooms) or "." not in room
        path = place / room.replace(".", "/")
        file = path / "__init__.py" if is_package else path.with_suffix(".py")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("".join(f"import {name}\n" for name in imported_names))


def _lint(place: Path) -> subprocess.CompletedProcess[str]:
    linter = Path(sys.executable).with_name("lint-imports")
    return subprocess.run(
        [linter, "--config", ROOT / "pyproject.toml", "--no-cache", "--no-logo"],
        cwd=place,
        env={**os.environ, "COLUMNS": "200", "NO_COLOR": "1"},
        capture_output=True,
        text=True,
        timeout=50,
        check=False,
    )


def _findings(output: str) -> dict[str, str]:
    """What was found against each contract, keyed by the contract's id."""
    _, _, broken = output.partition("Broken contracts")
    names = {contract["name"]: key for key, contract in _contracts().items()}
    parts = re.split(r"^(.+)\n-+\n", broken, flags=re.MULTILINE)
    return {names[head]: body for head, body in zip(parts[1::2], parts[2::2], strict=True) if head in names}


@pytest.fixture(scope="module")
def findings_in_a_broken_house(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    place = tmp_path_factory.mktemp("broken")
    _build_house(place, tuple((importer, imported) for _, importer, imported in BREACHES))
    result = _lint(place)
    assert result.returncode == 1, result.stdout + result.stderr
    return _findings(result.stdout)


def test_our_house_keeps_every_import_law() -> None:
    result = _lint(ROOT)
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize(("law", "importer", "imported"), BREACHES)
def test_each_breach_of_an_import_law_is_found(
    findings_in_a_broken_house: dict[str, str], law: str, importer: str, imported: str
) -> None:
    assert f"{importer} -> {imported} (l." in findings_in_a_broken_house[law]


def test_every_law_is_broken_once_above() -> None:
    assert {law for law, _, _ in BREACHES} == set(_contracts())


def test_the_named_bridges_may_be_crossed(tmp_path: Path) -> None:
    _build_house(tmp_path, BRIDGES)
    result = _lint(tmp_path)
    assert result.returncode == 0, result.stdout + result.stderr


def test_a_room_without_a_floor_is_refused(tmp_path: Path) -> None:
    _build_house(tmp_path, (("hardcore.attic", "hardcore.model.phases"),))
    result = _lint(tmp_path)
    assert result.returncode == 1
    assert "attic" in result.stdout


def test_every_pure_room_of_the_plan_exists_or_is_known_to_come_later() -> None:
    planned = set(_contracts()["pure-rooms"]["source_modules"])
    standing = {
        room
        for room in planned
        if (ROOT / room.replace(".", "/")).is_dir() or (ROOT / f"{room.replace('.', '/')}.py").is_file()
    }
    assert planned - standing == NOT_BUILT_YET


def _circle(graph: dict[str, set[str]]) -> list[str]:
    """The first circle among the files, empty when there is none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return [str(name) for name in error.args[1]]
    return []


def test_no_files_import_each_other_in_a_circle() -> None:
    graph = grimp.build_graph(*PACKAGES, cache_dir=None)
    assert _circle({name: graph.find_modules_directly_imported_by(name) for name in graph.modules}) == []


def test_a_circle_of_three_files_is_found() -> None:
    assert _circle({"a": {"b"}, "b": {"c"}, "c": {"a"}}) != []
