"""A test that leaves a process running fails, and the process is gone all the same."""

import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

from tests import leftovers, waiting

ROOT: Final = Path(__file__).parents[2]
HEAD: Final = "import subprocess, sys\n"
CHILD: Final = """
def test_leaves_a_child():
    subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
"""
# The child's child says that it is there and outlives its parent in a session of its own, knowing nothing of
# the test but the folder it works in.
ORPHAN: Final = """
def test_leaves_an_orphan(tmp_path):
    inner = "print(1, flush=True); import signal; signal.pause()"
    outer = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {inner!r}], start_new_session=True)"
    outer_process = subprocess.Popen([sys.executable, "-c", outer], cwd=tmp_path, env={}, stdout=subprocess.PIPE)
    assert outer_process.stdout.readline() == b"1\\n"
    outer_process.wait()
    outer_process.stdout.close()
"""
TIDY: Final = """
def test_ends_what_it_started():
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        process.kill()
"""


def _run(folder: Path, text: str) -> subprocess.CompletedProcess[str]:
    file = folder / "test_inner.py"
    file.write_text(HEAD + text, "utf-8")
    return subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-q", "-p", "tests.conftest", "-p", "no:cacheprovider"),
            *("-W", "ignore::pytest.PytestUnraisableExceptionWarning", "-W", "ignore::ResourceWarning"),
            *(f"--rootdir={folder}", f"--basetemp={folder / 'inner'}", str(file)),
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=50,
        check=False,
    )


def test_a_process_that_is_left_running_fails_its_test_and_is_ended(tmp_path: Path) -> None:
    result = _run(tmp_path, CHILD + ORPHAN + TIDY)
    assert "3 passed, 2 errors" in result.stdout, result.stdout + result.stderr
    for name in ("test_leaves_a_child", "test_leaves_an_orphan"):
        assert f"ERROR at teardown of {name}" in result.stdout
    assert result.stdout.count("\nleft running after the test: ") == 2
    assert leftovers.at_work_in(tmp_path) == set()


def test_waiting_gives_up_with_what_it_waited_for() -> None:
    with pytest.raises(AssertionError, match="for the moon to fall"):
        waiting.until(lambda: False, "the moon to fall", 0.0)


def test_waiting_gives_back_what_was_seen() -> None:
    looks = iter([0, 0, 7])
    assert waiting.until(lambda: next(looks), "the third look") == 7
