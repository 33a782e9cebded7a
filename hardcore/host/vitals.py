"""What the kernel says of a process and of its threads at one moment, in as few reads as that takes.

Ten times a second, so it counts: one read of `stat` has state, processor time, threads and memory together; a
library's process object reads four files for the same. A thread costs two reads and, because where it waits is
worth knowing only of one that waits, a third. Nothing here can wait for a lock that a stuck process holds: `maps`,
`smaps`, `cmdline` and `environ` can, and are never read on the loop that decides.
"""

import os
from collections.abc import Iterable
from pathlib import Path

import msgspec

from hardcore.model.looks import ProcessSample, ThreadSample

#: Threads of commands in flight that are looked at in one tick.
DECIDING_MAX = 8
#: A process of more threads is not counted through: a tick has no time for it.
COUNTED_THREADS_MAX = 128

_NS_PER_TICK = 1_000_000_000 // os.sysconf("SC_CLK_TCK")
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
_GONE = ThreadSample("", 0, "")

#: System calls by number, for kernels that don't show the function a thread waits in.
_CALLS = {
    "x86_64": {"202": "futex", "230": "clock_nanosleep", "35": "nanosleep", "232": "epoll_wait"},
    "aarch64": {"98": "futex", "115": "clock_nanosleep", "101": "nanosleep", "22": "epoll_pwait"},
}.get(os.uname().machine, {})


class Wanted(msgspec.Struct, frozen=True):
    """What is to be looked at beside the process itself: its threads by their ids, its descriptors, how many are busy."""

    loop: int = 0
    writer: int = 0
    beat: int = 0
    deciding: tuple[int, ...] = ()
    fds: bool = False
    busy: bool = False


def stat_fields(pid: int) -> list[str]:
    """Return the fields of `/proc/PID/stat` from the third (state) on. Raises OSError and ValueError."""
    return _fields(f"/proc/{pid}/stat")


def _fields(path: str) -> list[str]:
    fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        text = os.read(fd, 4096).decode("utf-8", "replace")
    finally:
        os.close(fd)
    return text[text.rindex(")") + 2 :].split()


def process_sample(pid: int, start: int, wanted: Wanted) -> ProcessSample | None:
    """Return what the kernel says of the process now; None if it is gone, or another has its number."""
    try:
        fields = stat_fields(pid)
        if int(fields[19]) != start:
            return None
        threads = _threads(pid, wanted)
        return ProcessSample(
            state=fields[0],
            cpu_ns=(int(fields[11]) + int(fields[12])) * _NS_PER_TICK,
            rss_bytes=int(fields[21]) * _PAGE_BYTES,
            threads=int(fields[17]),
            fds=count_fds(pid) if wanted.fds else None,
            loop=threads.get(wanted.loop),
            writer=threads.get(wanted.writer),
            beat=threads.get(wanted.beat),
            deciding=tuple((tid, threads[tid]) for tid in wanted.deciding if tid in threads),
            busy=count_busy(pid, (wanted.loop, wanted.beat)) if wanted.busy else None,
        )
    except (OSError, ValueError, IndexError):
        return None


def _threads(pid: int, wanted: Wanted) -> dict[int, ThreadSample]:
    """Look at each thread once, though it may be wanted in two places."""
    tids: Iterable[int] = (wanted.loop, wanted.writer, wanted.beat, *wanted.deciding[:DECIDING_MAX])
    return {tid: thread_sample(pid, tid) for tid in dict.fromkeys(tids) if tid}


def thread_sample(pid: int, tid: int) -> ThreadSample:
    """Return one thread's state, its times on and in wait of a processor, and what it sleeps in."""
    base = f"/proc/{pid}/task/{tid}"
    try:
        fields = _fields(f"{base}/stat")
        state, ticks = fields[0], int(fields[11]) + int(fields[12])
    except (OSError, ValueError, IndexError):
        return _GONE
    try:
        cpu_ns, run_delay_ns, turns = (int(word) for word in Path(f"{base}/schedstat").read_text().split())
    except (OSError, ValueError):  # a kernel without these counts knows its processor time in ticks alone
        cpu_ns, run_delay_ns, turns = ticks * _NS_PER_TICK, 0, 0
    return ThreadSample(state, cpu_ns, _waits_in(base), run_delay_ns, turns)


def _waits_in(base: str) -> str:
    try:
        where = Path(f"{base}/wchan").read_text().strip()
        if where and where != "0":
            return where
        number = Path(f"{base}/syscall").read_text().split()[0]
    except (OSError, IndexError):
        return ""
    return _CALLS.get(number, f"call {number}" if number != "running" else "")


def count_busy(pid: int, without: tuple[int, ...]) -> int | None:
    """Return how many threads run, are ready to, or wait for a disk, but for some; None: nobody can tell."""
    try:
        tids = os.listdir(f"/proc/{pid}/task")  # noqa: PTH208  # names alone, no objects
        if len(tids) > COUNTED_THREADS_MAX:
            return None
        return sum(
            _fields(f"/proc/{pid}/task/{tid}/stat")[0] in "RD" for tid in tids if int(tid) not in without
        )
    except (OSError, ValueError, IndexError):
        return None


def count_fds(pid: int) -> int | None:
    """Return how many descriptors the process has open; None when that may not be seen."""
    folder = f"/proc/{pid}/fd"
    try:
        # Newer kernels say it as the folder's size; listing the folder of a process that leaks takes long.
        return Path(folder).stat().st_size or len(os.listdir(folder))  # noqa: PTH208  # names alone, no objects
    except OSError:
        return None


def fds_limit(pid: int) -> int | None:
    """Return how many descriptors the process may have open; None: it is gone, or nothing limits it."""
    try:
        lines = Path(f"/proc/{pid}/limits").read_text().splitlines()
    except OSError:
        return None
    soft = next((line.split()[3] for line in lines if line.startswith("Max open files")), "")
    return int(soft) if soft.isdigit() else None
