"""The evidence has the end of the log also where that was cut a moment ago."""

from pathlib import Path

import pytest

from hardcore.snapshot import collectors
from hardcore.snapshot.collectors import collect_log
from hardcore.snapshot.subject import Haul, Subject

LATE_NS = 1 << 62


def tail(folder: Path) -> str:
    haul = Haul()
    collect_log(Subject(1, -1, "", folder, (folder / "core.log",), "", folder, folder), haul, LATE_NS)
    assert not haul.missing
    return haul.files["log.txt"].decode()


def test_a_log_that_was_cut_is_told_with_the_end_of_the_one_before(tmp_path: Path) -> None:
    (tmp_path / "core.log.1").write_text("the last words\n")
    (tmp_path / "core.log").write_text("the first\n")
    assert tail(tmp_path) == "== core.log\nthe last words\nthe first\n"


def test_a_line_whose_beginning_is_cut_off_is_not_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(collectors, "LOG_BYTES_MAX", 15)
    (tmp_path / "core.log.1").write_text("password=secret\n")
    (tmp_path / "core.log").write_text("the first\n")
    assert tail(tmp_path) == "== core.log\nthe first\n"
