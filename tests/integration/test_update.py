"""An update as a person does it: other code on the disk, `hardcore restart`, with real processes and a copy of all code.

The copy stands in front of this repository on the path of an environment of its own, so its files can be changed
while everything runs. What the core says of its API's version shows which of them it runs.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.integration.clients import assert_exactly_once, at_work
from tests.integration.house import WITH_SPARE, House
from tests.waiting import until

ROOT = Path(__file__).parents[2]
SHIPPED = ("core", "hardcore", "postmortem", "frontend", "templates", "examples")
LINE = "API_VERSION: Final = "


@dataclass
class Installed(House):
    """A house that runs a copy of the code, with an interpreter of its own."""

    root: Path = Path()

    @property
    def code(self) -> Path:
        return self.root / "code"

    def install(self) -> None:
        """Copy the code and make an environment that finds it first, and what it needs in ours."""
        leave = shutil.ignore_patterns("__pycache__")
        for name in SHIPPED:
            shutil.copytree(ROOT / name, self.code / name, ignore=leave)
        subprocess.run(
            [sys.executable, "-m", "venv", "--without-pip", "--symlinks", str(self.root / "env")], check=True
        )
        (packages,) = (self.root / "env" / "lib").glob("python*/site-packages")
        (packages / "copy.pth").write_text(f"{self.code}\n{sysconfig.get_path('purelib')}\n", "utf-8")

    def environment(self, **more: str) -> dict[str, str]:
        return super().environment(PYTHONPATH=str(self.code), **more)

    def begin(self, *options: str) -> "subprocess.Popen[bytes]":
        python = str(self.root / "env" / "bin" / "python")
        argv = [python, "-m", "hardcore.cli", "--data", str(self.data), "up", "--port", "0", *options]
        return self.begin_as(argv)

    def update(self, version: str, more: str = "") -> None:
        """Change the code on the disk: its version, and what comes behind it."""
        (file,) = (path for path in (self.code / "core").rglob("*.py") if LINE in path.read_text("utf-8"))
        kept = [line for line in file.read_text("utf-8").splitlines() if "half an update" not in line]
        lines = [f'{LINE}"{version}"' if line.startswith(LINE) else line for line in kept]
        new = file.with_suffix(".new")
        new.write_text("\n".join([*lines, more, ""]), "utf-8")
        os.replace(new, file)  # noqa: PTH105  # whole or not at all, as an installer does it

    def version(self) -> str:
        """Which code serves."""
        return str(self.ask("GET", "/api/openapi.json").body["info"]["version"])


@pytest.fixture
def house(tmp_path: Path) -> Iterator[Installed]:
    house = Installed(tmp_path / "data", WITH_SPARE, root=tmp_path)
    house.install()
    try:
        yield house.up()
    finally:
        house.end()


def test_an_update_is_taken_without_one_failed_request(house: Installed) -> None:
    before = house.spared()
    house.open_accounts()
    house.update("77.1")
    house.until(lambda s: s["spare"] and s["spare"]["build_fits"] is False, "the other code to be seen")
    with at_work(house, 2, "update", patient=False) as clients:
        until(lambda: len(clients.told) > 10, "the load to run")
        done = house.cli("restart")
        told = len(clients.told)
        until(lambda: len(clients.told) > told + 10, "answers of the next core")
    assert done.code == 0, done
    assert "with the new code" in done.out
    assert {told.status for told in clients.told} == {201}, clients.told
    assert_exactly_once(house, clients)
    assert house.version() == "77.1"
    assert house.status()["core"]["pid"] != before["core"]["pid"]


def test_an_update_that_does_not_start_changes_nothing_however_often_it_is_asked_for(
    house: Installed,
) -> None:
    before = house.spared()["core"]["pid"]
    version = house.version()
    house.update("77.2", 'raise RuntimeError("half an update")')
    for _ in range(4):
        done = house.cli("restart")
        assert done.code == 1, done
        assert "RuntimeError: half an update" in done.err
        assert (house.status()["core"]["pid"], house.version()) == (before, version)
    shown = house.cli("--lang", "ko", "status").out
    assert "half an update" in shown
    house.update("77.3")
    done = house.cli("restart")
    assert done.code == 0, done
    assert house.version() == "77.3"
    assert house.status()["core"]["pid"] != before


def test_without_a_spare_untried_code_is_tried_first_all_the_same(tmp_path: Path) -> None:
    house = Installed(tmp_path / "data", root=tmp_path)
    house.install()
    try:
        before = house.up().running()["core"]["pid"]
        house.update("77.4", 'raise RuntimeError("half an update")')
        done = house.cli("restart")
        assert (done.code, house.status()["core"]["pid"]) == (1, before), done
        assert "half an update" in done.err
        house.update("77.5")
        assert house.cli("restart").code == 0
        assert house.version() == "77.5"
        house.until(lambda s: s["spare"] is None, "the spare of the trial to be gone")
    finally:
        house.end()


def test_a_core_that_can_not_start_is_told_with_its_place_while_none_serves(tmp_path: Path) -> None:
    house = Installed(tmp_path / "data", {"max_restart_count": 1000, "backoff_max_ms": 400}, root=tmp_path)
    house.install()
    try:
        house.up().running()
        house.update("77.6", 'raise RuntimeError("half an update")')
        house.hit("core")
        told = house.until(lambda s: s["start_fault"], "the words of the core that can't start")
        assert told["start_fault"].startswith("RuntimeError: half an update (")
        assert "half an update" in house.cli("status").out
        assert "half an update" in house.cli("doctor").out
        house.update("77.7")
        house.until(lambda s: s["core"]["ready"] and not s["start_fault"], "a core to serve again")
    finally:
        house.end()
