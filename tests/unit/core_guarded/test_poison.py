"""The poison of a drill: armed by a file, and fatal to exactly the command or the event that is named."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from core.guarded.poison import FILE_BYTES_MAX, Armoury, At, Poison, is_name, name_of, read_poison

NAME = name_of("drill-1")

STRIKES = """
import sys, threading
from pathlib import Path
from core.guarded.poison import Armoury, At
armoury = Armoury(Path(sys.argv[1]))
armoury.read()
at, name, seq = At(sys.argv[2]), sys.argv[3], int(sys.argv[4])
armoury.strike(at, (name,))
armoury.rebuild(seq)
if at is At.LATER:
    print("answered", flush=True)
    for thread in threading.enumerate():
        if thread is not threading.main_thread():
            thread.join()
print("survived", flush=True)
"""


def armed(path: Path, at: str, name: str = NAME, seq: int | None = None) -> Path:
    path.write_text(json.dumps({"version": 1, "fault": "poison", "name": name, "at": at, "seq": seq}))
    return path


def struck(path: Path, at: str, name: str = NAME, seq: int = 0) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-c", STRIKES, str(path), at, name, str(seq)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize(
    ("armed_at", "met_at", "name", "seq", "said"),
    [
        ("decide", "decide", NAME, 0, ""),
        ("later", "later", NAME, 0, "answered\n"),
        ("log", "decide", NAME, 7, ""),
    ],
)
def test_it_kills_where_it_is_armed(
    tmp_path: Path, armed_at: str, met_at: str, name: str, seq: int, said: str
) -> None:
    done = struck(armed(tmp_path / "drill.json", armed_at, seq=7), met_at, name, seq)
    assert (done.returncode, done.stdout) == (-signal.SIGSEGV, said)


def test_each_of_several_kills(tmp_path: Path) -> None:
    path, other = tmp_path / "drill.json", name_of("drill-2")
    told = {"version": 1, "fault": "poison", "names": [NAME, other], "at": "decide", "seq": None}
    path.write_text(json.dumps(told))
    armoury = Armoury(path)
    armoury.read()
    assert armoury.armed == Poison(frozenset({NAME, other}), At.DECIDE)
    for name in (NAME, other):
        assert struck(path, "decide", name).returncode == -signal.SIGSEGV


def test_it_touches_nobody_else(tmp_path: Path) -> None:
    armoury = Armoury(armed(tmp_path / "drill.json", "write", seq=7))
    armoury.read()
    armoury.strike(At.WRITE, (name_of("drill-2"), ""))
    for at in (At.DECIDE, At.LATER, At.LOG):
        armoury.strike(at, (NAME,))
    armoury.rebuild(7)


@pytest.mark.parametrize(
    "raw",
    [
        b"",
        b"[]",
        b"{}",
        b"[" * 4_000,
        b'{"version": 1, "fault": "crash", "name": "%s", "at": "log"}' % NAME.encode(),
        b'{"version": 1, "fault": "poison", "name": "x", "at": "log"}',
        b'{"version": 1, "fault": "poison", "name": "%s", "at": "once"}' % NAME.encode(),
        b'{"version": 1, "fault": "poison", "name": "%s", "at": ["log"]}' % NAME.encode(),
        b'{"version": 1, "fault": "poison", "name": "%s", "at": "log", "seq": true}' % NAME.encode(),
        b'{"version": 1, "fault": "poison", "names": [], "at": "log"}',
        b'{"version": 1, "fault": "poison", "names": ["%s", "x"], "at": "log"}' % NAME.encode(),
        b'{"version": 1, "fault": "poison", "names": "%s", "at": "log"}' % NAME.encode(),
        b'{"version": 2, "fault": "poison", "name": "%s", "at": "log"}' % NAME.encode(),
    ],
)
def test_what_is_no_drill_arms_nothing(raw: bytes) -> None:
    assert read_poison(raw) is None


def test_a_file_that_is_too_long_disarms(tmp_path: Path) -> None:
    path = armed(tmp_path / "drill.json", "log", seq=3)
    armoury = Armoury(path)
    armoury.read()
    assert armoury.armed == Poison(frozenset({NAME}), At.LOG, 3)
    path.write_bytes(b" " * (FILE_BYTES_MAX + 1))
    armoury.read()
    assert armoury.armed is None


def test_a_file_that_is_gone_disarms(tmp_path: Path) -> None:
    path = armed(tmp_path / "drill.json", "log")
    armoury = Armoury(path)
    armoury.read()
    path.unlink()
    armoury.read()
    assert armoury.armed is None


def test_a_name_is_half_a_hash_of_the_key() -> None:
    assert is_name(name_of("any key at all, 열쇠"))
    assert not is_name("0" * 31)
    assert not is_name("../" + "0" * 29)
