"""What a process said last, out of its log: an error with its place, read without waiting."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from hardcore.host.said import LINE_CHARS_MAX, TAIL_BYTES_MAX, LogEnd, in_one_line


def _traceback_of(tmp_path: Path, source: str) -> str:
    (tmp_path / "core").mkdir()
    file = tmp_path / "core" / "limits.py"
    file.write_text(source, "utf-8")
    argv = [sys.executable, "-I", "-c", f"import runpy; runpy.run_path({str(file)!r})"]
    return subprocess.run(argv, capture_output=True, text=True, check=False).stderr


def test_an_error_is_said_with_the_file_and_the_line_that_it_is_in(tmp_path: Path) -> None:
    said = in_one_line(_traceback_of(tmp_path, "x = 1\ndef (:\n"))
    assert said == "SyntaxError: invalid syntax (core/limits.py, line 2)"


def test_an_error_of_a_running_program_is_said_with_the_place_where_it_was_raised(tmp_path: Path) -> None:
    said = in_one_line(_traceback_of(tmp_path, "def f():\n    raise RuntimeError('no way')\nf()\n"))
    assert said == "RuntimeError: no way (core/limits.py, line 2)"


def test_what_comes_after_an_error_does_not_hide_it() -> None:
    assert in_one_line("ValueError: bad\nclosing\n") == "ValueError: bad"


@pytest.mark.parametrize(("log", "said"), [("", ""), ("\n \n", ""), ("one\ntwo\n\n", "two")])
def test_without_an_error_the_last_line_is_what_was_said(log: str, said: str) -> None:
    assert in_one_line(log) == said


def test_a_line_is_short_and_moves_no_cursor() -> None:
    said = in_one_line("ValueError: \x1b[2J" + "x" * 10_000)
    assert len(said) == LINE_CHARS_MAX
    assert said.isprintable()


@pytest.mark.parametrize("folder", ["/dev/shm", None])
def test_only_what_was_said_since_the_start_counts(folder: str | None, tmp_path: Path) -> None:
    log = Path(folder or tmp_path) / f"said-{os.getpid()}.log"
    try:
        log.write_text("RuntimeError: an older life\n", "utf-8")
        end = LogEnd(log)
        assert end.last_said() == ""
        with log.open("a", encoding="utf-8") as file:
            file.write("x\n" * TAIL_BYTES_MAX + "RuntimeError: this one\n")
        assert end.last_said() == "RuntimeError: this one"
        end.close()
        end.close()
        assert end.last_said() == ""
    finally:
        log.unlink()
