"""Processes of ours by pidfd: a number that names somebody else by now is never signalled."""

import asyncio
import errno
import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from hardcore.host import processes
from hardcore.host.processes import Handle, Identity
from hardcore.host.vitals import Wanted
from tests.waiting import until

SLEEPER = [sys.executable, "-c", "import time; print('up', flush=True); time.sleep(600)"]
CHILDREN = """
import subprocess, sys, time
sleep = [sys.executable, '-c', 'import time; time.sleep(600)']
print(subprocess.Popen(sleep).pid, subprocess.Popen(sleep, start_new_session=True).pid, flush=True)
time.sleep(600)
"""
FAMILY = [sys.executable, "-c", CHILDREN]

Spawn = Callable[[list[str]], Handle]


@pytest.fixture
def spawn(tmp_path: Path) -> Iterator[Spawn]:
    """Start processes that are gone when the test is over."""
    handles: list[Handle] = []

    def start(argv: list[str]) -> Handle:
        log = tmp_path / "log"
        log.unlink(missing_ok=True)
        handles.append(processes.spawn(argv, {"PATH": os.environ["PATH"]}, log, tmp_path))
        return handles[-1]

    yield start
    for handle in handles:
        handle.kill_tree()
        gone(handle)
        with suppress(ChildProcessError):  # reaped in the test
            handle.reap()
        handle.close()


def gone(handle: Handle) -> None:
    assert select.select([handle.pidfd], [], [], 10)[0], f"{handle.pid} lives"


def said(tmp_path: Path) -> str:
    return until(lambda: (tmp_path / "log").read_text().strip(), "the process to speak")


def test_a_process_is_found_again_by_number_and_start(spawn: Spawn) -> None:
    ours = spawn(SLEEPER)
    found = processes.find(ours.identity)
    assert found is not None
    assert found.signal(0)
    found.close()


def test_a_process_with_our_number_and_another_start_is_not_ours(spawn: Spawn) -> None:
    stranger = spawn(SLEEPER)
    assert processes.find(Identity(stranger.pid, stranger.identity.start - 1)) is None
    assert stranger.signal(0)


def test_a_process_that_is_gone_or_only_waits_to_be_reaped_is_not_found(spawn: Spawn) -> None:
    ours = spawn(SLEEPER)
    ours.signal(signal.SIGKILL)
    gone(ours)
    assert processes.find(ours.identity) is None
    assert ours.reap() is not None
    assert processes.find(ours.identity) is None


def test_a_signal_to_one_that_is_gone_says_so_and_reaches_nobody(spawn: Spawn) -> None:
    ours = spawn(SLEEPER)
    ours.signal(signal.SIGKILL)
    gone(ours)
    ours.reap()
    assert not ours.signal(signal.SIGKILL)


def test_a_tree_is_killed_to_the_edge_of_its_session_and_no_further(spawn: Spawn, tmp_path: Path) -> None:
    ours = spawn(FAMILY)
    same, other = (os.pidfd_open(int(pid)) for pid in said(tmp_path).split())
    try:
        ours.kill_tree()
        gone(ours)
        assert select.select([same], [], [], 10)[0], "a child in the session lives"
        assert not select.select([other], [], [], 0)[0], "a process of another session was killed"
    finally:
        signal.pidfd_send_signal(other, signal.SIGKILL)
        select.select([other], [], [], 10)
        os.close(same)
        os.close(other)


def test_a_session_under_a_number_that_a_stranger_has_by_now_is_left_alone(
    spawn: Spawn, tmp_path: Path
) -> None:
    gone_already = spawn(SLEEPER)
    gone_already.signal(signal.SIGKILL)
    gone(gone_already)
    stranger = spawn(FAMILY)
    same, other = (os.pidfd_open(int(pid)) for pid in said(tmp_path).split())
    try:
        number = Identity(stranger.pid, stranger.identity.start - 1)
        Handle(number, gone_already.pidfd, child=False).kill_tree()
        assert stranger.signal(0)
        assert not select.select([same], [], [], 0)[0], "a stranger's child was killed"
    finally:
        signal.pidfd_send_signal(other, signal.SIGKILL)
        select.select([other], [], [], 10)
        os.close(same)
        os.close(other)


def test_the_tree_of_a_process_that_is_gone_leaves_everybody_alone(spawn: Spawn) -> None:
    gone_already, stranger = spawn(SLEEPER), spawn(SLEEPER)
    gone_already.signal(signal.SIGKILL)
    gone(gone_already)
    gone_already.reap()
    gone_already.kill_tree()
    assert stranger.signal(0)


@pytest.mark.parametrize(
    ("code", "exit_code", "number"),
    [("raise SystemExit(7)", 7, None), ("import os; os.kill(os.getpid(), 9)", None, 9)],
)
def test_the_way_it_ended_is_read_once_it_has(
    spawn: Spawn, code: str, exit_code: int | None, number: int | None
) -> None:
    ours = spawn([sys.executable, "-c", code])
    gone(ours)
    how = ours.reap()
    assert how is not None
    assert (how.code, how.signal) == (exit_code, number)


def test_a_living_process_has_not_ended(spawn: Spawn) -> None:
    assert spawn(SLEEPER).reap() is None


def test_somebody_elses_child_ends_without_a_status(tmp_path: Path) -> None:
    with subprocess.Popen(SLEEPER, cwd=tmp_path, stdout=subprocess.DEVNULL) as process:
        start = processes.start_of(process.pid)
        assert start is not None
        handle = processes.find(Identity(process.pid, start))
        assert handle is not None
        assert handle.reap() is None
        process.kill()
        gone(handle)
        how = handle.reap()
        assert how is not None
        assert (how.code, how.signal) == (None, None)
        handle.close()


def test_a_process_has_a_session_of_its_own_and_inherits_nothing_it_was_not_given(
    spawn: Spawn, tmp_path: Path
) -> None:
    kept = os.open(tmp_path / "secret", os.O_CREAT | os.O_RDWR)
    os.set_inheritable(kept, True)
    try:
        ours = spawn(
            [sys.executable, "-c", "import os; print(os.getsid(0), len(os.listdir('/proc/self/fd')))"]
        )
        session, descriptors = said(tmp_path).split()
        assert int(session) == ours.pid
        assert int(descriptors) <= 4, "standard ones, and the listing's own"
    finally:
        os.close(kept)


def test_what_can_not_be_started_is_an_error_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No such file"):
        processes.spawn([str(tmp_path / "nothing")], {}, tmp_path / "log", tmp_path)


@pytest.mark.parametrize("missing", ["pidfd", "start"])
def test_what_was_started_and_can_not_be_held_is_ended_before_that_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    def none_left(_pid: int) -> int:
        raise OSError(errno.EMFILE, "Too many open files")

    before = len(list(Path("/proc/self/fd").iterdir()))
    if missing == "pidfd":
        monkeypatch.setattr(os, "pidfd_open", none_left)
    else:
        monkeypatch.setattr(processes, "start_of", lambda _pid: None)
    with pytest.raises(OSError, match=r"Too many|start time"):
        processes.spawn(SLEEPER, {"PATH": os.environ["PATH"]}, tmp_path / "log", tmp_path)
    assert not psutil.Process().children(), "it lives, or was not reaped"
    assert len(list(Path("/proc/self/fd").iterdir())) == before


def test_a_process_is_killed_although_nobody_can_look_for_its_session(
    spawn: Spawn, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none_left(_path: Path) -> Iterator[Path]:
        raise OSError(errno.EMFILE, "Too many open files")

    ours = spawn(SLEEPER)
    with monkeypatch.context() as patched:
        patched.setattr(Path, "iterdir", none_left)
        ours.kill_tree()
    gone(ours)


def test_a_stopped_process_is_seen_as_stopped(spawn: Spawn, tmp_path: Path) -> None:
    ours = spawn(SLEEPER)
    said(tmp_path)

    def state() -> str:
        sample = ours.sample(Wanted())
        return sample.state if sample else ""

    until(lambda: state() == "S", "it to sleep")
    ours.signal(signal.SIGSTOP)
    until(lambda: state() == "T", "it to be stopped")
    ours.signal(signal.SIGCONT)
    until(lambda: state() == "S", "it to sleep again")


def test_a_process_that_is_gone_has_no_sample(spawn: Spawn) -> None:
    ours = spawn(SLEEPER)
    assert ours.sample(Wanted(fds=True)) is not None
    ours.signal(signal.SIGKILL)
    gone(ours)
    ours.reap()
    assert ours.sample(Wanted()) is None


def test_a_handle_that_was_closed_signals_nobody_who_has_its_descriptor_now(
    spawn: Spawn, tmp_path: Path
) -> None:
    stranger = spawn(SLEEPER)
    ours = processes.spawn(SLEEPER, {"PATH": os.environ["PATH"]}, tmp_path / "ours", tmp_path)
    number = ours.pidfd
    ours.kill_tree()
    gone(ours)
    ours.reap()
    ours.close()
    os.dup2(stranger.pidfd, number)  # its number again, and another's process
    try:
        assert not ours.signal(signal.SIGKILL)
        ours.kill_tree()
        ours.close()
        assert ours.copy() is None
        assert stranger.signal(0)
        assert asyncio.run(processes.gone(ours, 0)), "who waits for it need not look"
    finally:
        os.close(number)
    assert stranger.reap() is None


def test_a_handle_that_was_closed_early_says_truly_that_its_process_lives(spawn: Spawn) -> None:
    living = spawn(SLEEPER)
    found = processes.find(living.identity)
    assert found is not None
    found.close()
    assert not asyncio.run(processes.gone(found, 0))
