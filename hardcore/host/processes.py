"""Processes of ours: started, looked at, signalled, ended; always through a pidfd.

A pid alone names whoever has it now: a supervisor that kills by a remembered number sooner or later hits a
stranger. So an identity is pid + start time, the pidfd is opened *first* and the start time compared *after*,
and every signal goes through the descriptor.
"""

import errno
import os
import signal
import subprocess
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from hardcore.host.vitals import Wanted, process_sample, stat_fields
from hardcore.model.looks import ProcessSample
from hardcore.model.observations import Exit


class Identity(msgspec.Struct, frozen=True):
    """Who a process is: its number, and when it started in the kernel's ticks since boot."""

    pid: int
    start: int


def start_of(pid: int) -> int | None:
    """Return the start time of the process that has this pid now, or None if there is none."""
    try:
        return int(stat_fields(pid)[19])
    except (OSError, ValueError, IndexError):
        return None


class Handle:
    """A process of ours, held by its pidfd. Once it is closed, whose number the descriptor has now is never signalled."""

    def __init__(self, identity: Identity, pidfd: int, *, child: bool) -> None:
        self.identity = identity
        self.pidfd = pidfd
        self.child = child
        self._closed = False
        self._using = threading.Lock()  # a hand may signal while the loop gives the descriptor back

    @property
    def pid(self) -> int:
        """Its number, for people to read; never to signal by."""
        return self.identity.pid

    def signal(self, number: int) -> bool:
        """Send a signal through the pidfd; return whether the process was still there."""
        with self._using:
            if self._closed:
                return False
            try:
                signal.pidfd_send_signal(self.pidfd, number)
            except ProcessLookupError:
                return False
            return True

    def kill_tree(self) -> None:
        """SIGKILL the process and everything in its session.

        A number is not given out again while a session bears it: if a stranger has it, our session is empty,
        and the one found under it is the stranger's.
        """
        try:
            members = _session_members(self.pid)
        except OSError:
            members = []  # no descriptor left to look with; the process itself is ended all the same
        self.signal(signal.SIGKILL)
        if start_of(self.pid) not in {None, self.identity.start}:
            return
        for pid in members:
            _kill_member(pid, self.pid)

    def reap(self) -> Exit | None:
        """Return how the process ended, or None while it has not. Someone else's child has no status."""
        if not self.child:
            return Exit() if not self.signal(0) or self._zombie() else None
        result = os.waitid(os.P_PIDFD, self.pidfd, os.WEXITED | os.WNOHANG)
        if result is None:
            return None
        if result.si_code == os.CLD_EXITED:
            return Exit(code=result.si_status)
        return Exit(signal=result.si_status)

    def _zombie(self) -> bool:
        try:
            return stat_fields(self.pid)[0] in {"Z", "X"}
        except (OSError, IndexError):
            return True

    def sample(self, wanted: Wanted) -> ProcessSample | None:
        """Return what the kernel says of it now; None: it is gone."""
        return process_sample(self.pid, self.identity.start, wanted)

    def close(self) -> None:
        """Give the descriptor back."""
        with self._using:
            if not self._closed:
                self._closed = True
                os.close(self.pidfd)

    def copy(self) -> int | None:
        """Return a descriptor of the process for whoever waits for its end; None: it was given back."""
        with self._using:
            return None if self._closed else os.dup(self.pidfd)


async def gone(handle: Handle, within_s: float) -> bool:
    """Wait until the process is gone; return whether it is."""
    # Whoever waits here runs a loop and has it loaded; a command that only looks at processes is spared 20 ms.
    import asyncio

    loop = asyncio.get_running_loop()
    ended = asyncio.Event()
    fd = handle.copy()
    if fd is None:  # somebody has seen to its end meanwhile
        return start_of(handle.pid) != handle.identity.start
    loop.add_reader(fd, ended.set)
    try:
        await asyncio.wait_for(ended.wait(), max(0.0, within_s))
    except TimeoutError:
        return False
    else:
        return True
    finally:
        loop.remove_reader(fd)
        os.close(fd)


def _session_members(session: int) -> list[int]:
    pids = (int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit())
    return [pid for pid in pids if pid != session and _session_of(pid) == session]


def _session_of(pid: int) -> int:
    try:
        return int(stat_fields(pid)[3])
    except (OSError, ValueError, IndexError):
        return 0


def _kill_member(pid: int, session: int) -> None:
    try:
        pidfd = os.pidfd_open(pid)
    except OSError:
        return
    try:
        if _session_of(pid) == session:  # asked again, now that the descriptor pins who it is
            signal.pidfd_send_signal(pidfd, signal.SIGKILL)
    except ProcessLookupError:
        pass
    finally:
        os.close(pidfd)


def find(identity: Identity) -> Handle | None:
    """Return a handle on a process started earlier, if it is still the same one and still there."""
    try:
        pidfd = os.pidfd_open(identity.pid)
    except OSError:
        return None
    handle = Handle(identity, pidfd, child=False)
    if start_of(identity.pid) == identity.start and handle.reap() is None:
        return handle
    handle.close()
    return None


def spawn(
    argv: Sequence[str],
    environment: Mapping[str, str],
    log: Path,
    cwd: Path,
    fds: Sequence[int] = (),
    stdout: int | None = None,
) -> Handle:
    """Start a process in a session of its own, its output appended to `log`.

    Output goes to a file, never through the guard: a pipe to a dead guard would stop or kill the core. `stdout`: a
    descriptor for what it prints, of one that shall end with the guard.
    Raises OSError when it can't be started or can't be held; then nothing of it is left.
    """
    out = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o600)
    try:
        process = subprocess.Popen(
            argv,
            env=dict(environment),
            cwd=cwd,
            stdin=subprocess.DEVNULL,
            stdout=out if stdout is None else stdout,
            stderr=out,
            start_new_session=True,
            pass_fds=tuple(fds),
        )
    finally:
        os.close(out)
    try:
        handle = _held(process.pid)
    except BaseException:
        process.kill()  # a process that nobody holds would live on beside the next one
        process.wait()
        raise
    process.returncode = 0  # the pidfd is what it is waited on with; Popen must never try by number
    return handle


def _held(child: int) -> Handle:
    """Return a handle on an unreaped child of ours. Raises OSError when there is no descriptor left for it."""
    pidfd = os.pidfd_open(child)
    start = start_of(child)
    if start is None:  # an unreaped child is in /proc, but reading there needs a descriptor too
        os.close(pidfd)
        raise OSError(errno.EMFILE, "its start time can't be read")
    return Handle(Identity(child, start), pidfd, child=True)
