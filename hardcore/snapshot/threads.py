"""What the kernel tells of each thread, and the stop of all of them.

Read from /proc, because the kernel answers for a process that answers to nobody. The command line, the
environment and the memory map stay unread: the first two may hold secrets, and reading any of them waits
for a lock that a stuck process may hold for ever.
"""

import os
import signal
import time
from pathlib import Path

import msgspec
from msgspec import structs

from hardcore.snapshot.recipe import STOP_WAIT_MS_MAX
from hardcore.snapshot.subject import Haul, Subject

#: More threads than this are counted, not described.
THREADS_MAX = 256
_POLL_S = 0.001
_TICK_MS = 1000 // os.sysconf("SC_CLK_TCK")


class ThreadFacts(msgspec.Struct, frozen=True):
    """One thread: the kernel's letter for its state, the kernel function and system call it sleeps in."""

    tid: int
    name: str
    state: str
    cpu_ms: int
    wchan: str
    syscall: str


def collect_threads(subject: Subject, haul: Haul, threads: list[ThreadFacts], until_ns: int) -> None:
    """Add the facts of each thread to `threads`. To be done before the stop, which hides them."""
    tids = thread_ids(subject.pid)
    if not tids:
        haul.missing["threads"] = "the process was gone"
    for tid in tids[:THREADS_MAX]:
        if time.monotonic_ns() > until_ns:
            haul.missing["threads"] = f"only {len(threads)} of {len(tids)} threads before the time was over"
            return
        if (facts := _thread_facts(subject.pid, tid)) is not None:
            threads.append(facts)
    if len(tids) > THREADS_MAX:
        haul.missing["threads"] = f"only {THREADS_MAX} of {len(tids)} threads are described"


def stop(subject: Subject, haul: Haul, until_ns: int) -> None:
    """Stop the process and wait until every thread stands still; note when that was."""
    limit_ns = min(until_ns, time.monotonic_ns() + STOP_WAIT_MS_MAX * 1_000_000)
    try:
        signal.pidfd_send_signal(subject.pidfd, signal.SIGSTOP)
    except OSError as error:
        haul.missing["stop"] = f"the process could not be stopped: {error.strerror}"
        return
    while moving := _moving(subject.pid):
        if time.monotonic_ns() > limit_ns:
            tid, state = moving[0]
            haul.missing["stop"] = f"{len(moving)} thread(s) did not stop, thread {tid} is in state {state}"
            return
        time.sleep(_POLL_S)
    haul.steps.append(("frozen", time.monotonic_ns()))


def stands_still(pid: int) -> bool:
    """Tell whether the process exists and no thread of it runs: it could not answer a signal."""
    return bool(thread_ids(pid)) and not _moving(pid)


def thread_ids(pid: int) -> list[int]:
    """Return the ids of the threads, the main one first; empty when the process is gone."""
    try:
        return sorted(int(path.name) for path in Path(f"/proc/{pid}/task").iterdir())
    except OSError:
        return []


def as_json(threads: list[ThreadFacts]) -> list[dict[str, object]]:
    """Return the facts in the form of `process.json`."""
    return [structs.asdict(facts) for facts in threads]


def _moving(pid: int) -> list[tuple[int, str]]:
    states = ((tid, _stat(pid, tid)) for tid in thread_ids(pid))
    return [(tid, stat[0]) for tid, stat in states if stat is not None and stat[0] not in "TtZX"]


def _thread_facts(pid: int, tid: int) -> ThreadFacts | None:
    stat = _stat(pid, tid)
    if stat is None:
        return None
    return ThreadFacts(
        tid=tid,
        name=_line(pid, tid, "comm"),
        state=stat[0],
        cpu_ms=stat[1] * _TICK_MS,
        wchan=_line(pid, tid, "wchan"),
        syscall=_line(pid, tid, "syscall"),
    )


def _stat(pid: int, tid: int) -> tuple[str, int] | None:
    """Return (state, CPU ticks), or None if the thread is gone."""
    # The name stands in brackets and may hold brackets itself, so the fields count from the last one.
    fields = _line(pid, tid, "stat").rpartition(")")[2].split()
    return (fields[0], int(fields[11]) + int(fields[12])) if len(fields) > 12 else None


def _line(pid: int, tid: int, name: str) -> str:
    try:
        return Path(f"/proc/{pid}/task/{tid}/{name}").read_text("utf-8", "replace").strip()
    except OSError:
        return ""
