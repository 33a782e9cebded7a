"""Kills for want of memory: counted where the process lives, and a group of its own for one that may be ended."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hardcore.host import memory
from tests.waiting import until

EATER = """
import sys
sys.stdin.read(1)
held = []
while True:
    held.append(bytearray(1 << 20))
"""


@contextmanager
def eater() -> Iterator["subprocess.Popen[bytes]"]:
    with subprocess.Popen([sys.executable, "-c", EATER], stdin=subprocess.PIPE) as process:
        yield process
        process.kill()


def confined(pid: int) -> memory.Confined:
    made = memory.confine(pid, 24 << 20)
    if isinstance(made, str):
        pytest.skip(made)
    return made


def test_a_counter_that_has_not_moved_has_risen_by_nothing() -> None:
    counter = memory.oom_counter(os.getpid())
    if counter is None:
        pytest.skip("nobody counts here")
    assert counter.kind in {"cgroup2", "cgroup1", "vmstat"}
    assert counter.risen() == 0


def test_a_counter_that_can_not_be_read_any_more_says_nothing(tmp_path: Path) -> None:
    path = tmp_path / "memory.events"
    path.write_text("low 0\noom 3\noom_kill 2\n")
    counter = memory.OomCounter(path, 1)
    assert (counter.kind, counter.risen()) == ("cgroup2", 1)
    path.write_text("oom_kill many\n")
    assert counter.risen() is None
    path.unlink()
    assert counter.risen() is None


def test_a_confined_process_that_grows_is_killed_and_counted_and_its_group_is_removed() -> None:
    with eater() as process:
        made = confined(process.pid)
        counter = memory.oom_counter(process.pid)
        assert counter is not None
        assert counter.path == made.group.counter
        assert process.stdin is not None
        process.stdin.write(b"x")
        process.stdin.flush()
        assert process.wait(20) == -signal.SIGKILL
        assert counter.risen() == 1
    until(lambda: memory.dissolve(made), "the group to be removed")


def test_the_group_of_a_process_that_lives_is_not_removed_and_a_dead_ones_is_swept_by_the_next() -> None:
    with eater() as process:
        made = confined(process.pid)
        assert not memory.dissolve(made)
    with eater() as other:
        second = confined(other.pid)
        until(lambda: not made.group.folder.exists() or memory.dissolve(made), "the dead one's group to go")
    until(lambda: memory.dissolve(second), "the group to be removed")


def test_a_process_that_is_gone_can_not_be_confined_and_nothing_is_left() -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        process.wait()
    assert isinstance(memory.confine(process.pid), str)


def test_trying_whether_a_group_can_be_made_leaves_none() -> None:
    can = memory.can_confine()
    group = memory.group_of(os.getpid())
    assert group is not None or not can
    if group is not None:
        for place in (group.folder, group.folder.parent):
            assert not list(place.glob(f"hardcore-core-try-{os.getpid()}"))


def group(folder: Path, version: int, limit: str, used: int, cached: int) -> memory.Group:
    names = ("max", "current", "inactive_file") if version == 2 else memory._NAMES_1
    (folder / f"memory.{names[0]}").write_text(f"{limit}\n")
    (folder / f"memory.{names[1]}").write_text(f"{used}\n")
    (folder / "memory.stat").write_text(f"anon 1\n{names[2]} {cached}\n")
    return memory.Group(folder, version)


@pytest.mark.parametrize("version", [1, 2])
def test_what_a_group_uses_for_files_that_nobody_needs_is_free(tmp_path: Path, version: int) -> None:
    assert group(tmp_path, version, "1000", 600, 150).free_bytes() == 550
    assert group(tmp_path, version, "1000", 5000, 0).free_bytes() == 0


def test_a_group_without_a_limit_or_without_an_account_limits_nothing(tmp_path: Path) -> None:
    assert group(tmp_path, 2, "max", 600, 150).free_bytes() is None
    assert memory.Group(tmp_path / "gone", 1).free_bytes() is None


def test_a_limit_of_a_group_above_holds_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    below = tmp_path / "above" / "below"
    below.mkdir(parents=True)
    group(below.parent, 2, "1000", 400, 0)
    inner = group(below, 2, "max", 300, 0)
    monkeypatch.setattr(memory, "_MOUNT", tmp_path)
    monkeypatch.setattr(memory, "group_of", lambda _pid: inner)
    assert memory.free_bytes(os.getpid()) == 600


def test_this_machine_says_how_much_memory_is_free() -> None:
    free = memory.free_bytes(os.getpid())
    assert free is not None
    assert free > 0
