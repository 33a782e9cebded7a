"""What the launcher goes by: whether everything was stopped, how soon the next comes, and that words never hold it."""

import subprocess
import sys
from pathlib import Path

import pytest

from hardcore.launcher import ENDS_MAX, PAUSE_S, PAUSE_S_MAX, SHORT_LIFE_S, Pace, took_leave


@pytest.mark.parametrize(
    ("left", "stopped"),
    [
        (("sentinel.json",), True),
        (("sentinel.json", "sentinel.page"), False),
        ((), False),
    ],
)
def test_a_sentinel_that_left_its_page_has_not_stopped_everything(
    tmp_path: Path, left: tuple[str, ...], *, stopped: bool
) -> None:
    for name in left:
        (tmp_path / name).touch()
    assert took_leave(str(tmp_path)) is stopped


def test_one_that_lived_is_followed_at_once() -> None:
    pace = Pace()
    pauses = [pace.pause_s(at, at + 10 * SHORT_LIFE_S) for at in range(0, 100 * ENDS_MAX, 100)]
    assert set(pauses) == {0.0}


def test_short_lives_are_followed_more_slowly_each_time_and_never_not() -> None:
    pace = Pace()
    pauses = [pace.pause_s(at, at + SHORT_LIFE_S / 2) for at in range(0, 1000, 100)]
    assert pauses[:3] == [PAUSE_S, 2 * PAUSE_S, 4 * PAUSE_S]
    assert pauses == sorted(pauses)
    assert pauses[-1] == PAUSE_S_MAX
    assert pace.pause_s(2000, 2000 + 2 * SHORT_LIFE_S) == 0


def test_many_ends_in_a_minute_are_followed_slowly_however_long_each_lived() -> None:
    pace = Pace()
    pauses = [pace.pause_s(at, at + 1.5 * SHORT_LIFE_S) for at in range(0, 2 * ENDS_MAX + 2, 2)]
    assert pauses == [0.0] * ENDS_MAX + [PAUSE_S_MAX]


FULL = """
import os
from hardcore.launcher import say
os.set_blocking(2, False)
try:
    while os.write(2, bytes(65536)):
        pass
except BlockingIOError:
    os.set_blocking(2, True)
say(b"one")
say(b"two")
os.write(1, b"went on")
input()
"""


def test_a_terminal_that_takes_nothing_holds_nobody() -> None:
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", FULL], stdin=pipe, stdout=pipe, stderr=pipe) as process:
        assert process.stdout is not None
        assert process.stdout.read(7) == b"went on"
        process.kill()
