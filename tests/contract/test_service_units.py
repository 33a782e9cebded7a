"""What is written for systemd and for monitors: judged by systemd itself, and held to the names we print."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from click.testing import CliRunner

from hardcore.cli import main
from hardcore.crisis import metrics
from hardcore.opening import Opening
from hardcore.service_words import Place, in_unit, units
from tests.contract.test_doors import COUNTERS, STATUS

DOCS = Path(__file__).parents[2] / "docs"
ANALYZE = shutil.which("systemd-analyze")


def _written(folder: Path, *, user: bool) -> list[Path]:
    made = units(Place("hardcore", user, "daemon"), folder / "da ta 100%", Opening(), 3000)
    paths = [folder / path.name for path in made]
    for path, text in zip(paths, made.values(), strict=True):
        path.write_text(text)
    return paths


@pytest.mark.skipif(ANALYZE is None, reason="no systemd-analyze here")
@pytest.mark.parametrize("user", [True, False])
def test_systemd_finds_nothing_wrong_with_the_units(tmp_path: Path, user: bool) -> None:
    argv = [str(ANALYZE), "verify", *map(str, _written(tmp_path, user=user))]
    done = subprocess.run(argv, capture_output=True, text=True, timeout=50, check=False)
    ours = [line for line in done.stderr.splitlines() if str(tmp_path) in line]
    assert (done.returncode, ours) == (0, []), done.stderr


@pytest.mark.skipif(ANALYZE is None, reason="no systemd-analyze here")
def test_the_machines_unit_is_well_closed(tmp_path: Path) -> None:
    unit = next(path for path in _written(tmp_path, user=False) if path.suffix == ".service")
    argv = [str(ANALYZE), "security", "--offline=true", "--threshold=25", str(unit)]
    done = subprocess.run(argv, capture_output=True, text=True, timeout=50, check=False)
    assert done.returncode == 0, done.stdout[-400:]


def test_a_folder_with_a_space_or_a_percent_sign_is_one_word() -> None:
    assert in_unit("/a b/100%") == '"/a b/100%%"'


def test_a_dry_run_shows_everything_and_writes_nothing(tmp_path: Path) -> None:
    asked = ["--json", "--data", str(tmp_path / "data"), "service", "install", "--system", "--as", "daemon"]
    done = CliRunner().invoke(main, [*asked, "--dry-run", "--name", "never-written-by-a-test"])
    told = json.loads(done.output)
    assert (done.exit_code, told["dry_run"], len(told["files"]), len(told["commands"])) == (0, True, 2, 3)
    assert not any(Path(path).exists() for path in told["files"])
    assert not (tmp_path / "data").exists()


def test_a_dashboard_and_rules_name_only_numbers_that_there_are() -> None:
    moment = metrics.Moment("1", True, "OPERATIONAL", 1, 0.1, 0, 0, 0, {"answered": 1}, STATUS, COUNTERS)
    printed = metrics.text(moment, openmetrics=False).decode()
    known = {line.partition("{")[0].partition(" ")[0] for line in printed.splitlines() if line[0] != "#"}
    for name in ("grafana.json", "rules.yaml"):
        used = set(re.findall(r"\bhardcore_[a-z_]+", (DOCS / "monitoring" / name).read_text()))
        assert used
        assert used <= known, used - known


def test_every_number_that_is_printed_is_explained() -> None:
    moment = metrics.Moment("1", True, "OPERATIONAL", 1, 0.1, 0, 0, 0, {"answered": 1}, STATUS, COUNTERS)
    told = (DOCS / "monitoring.md").read_text()
    missing = [one.name for one in metrics.families(moment) if one.name not in told and one.name != "build"]
    assert missing == []


def test_the_dashboard_is_a_dashboard() -> None:
    board = json.loads((DOCS / "monitoring" / "grafana.json").read_text())
    panels = board["panels"]
    assert board["schemaVersion"] >= 36
    assert len({panel["id"] for panel in panels}) == len(panels)
    assert all(
        panel["targets"][0]["expr"] and set(panel["gridPos"]) == {"h", "w", "x", "y"} for panel in panels
    )
