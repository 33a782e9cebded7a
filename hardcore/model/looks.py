"""What a look at the core and its surroundings shows: threads, stacks, who holds a lock, the disk, the log.

They are the parts that the facts of `observations.py` are made of. None of them has a moment or a life of its own: the
fact that carries it says when it was seen, and of which core.
"""

import msgspec


class ThreadSample(msgspec.Struct, frozen=True):
    """One thread of the core. `state` is the kernel's letter, empty when the thread is gone."""

    state: str
    cpu_ns: int
    waits_in: str  # kernel function or system call it sleeps in; empty when unknown
    run_delay_ns: int = 0  # time it was ready to run and was not let
    switches: int = 0  # context switches, of both kinds


class ProcessSample(msgspec.Struct, frozen=True):
    """The core as the kernel sees it at one tick.

    `beat` is the thread of the thread beat; `deciding` are the threads of the commands in flight, by their ids.
    `busy`: how many threads besides the loop's and the beat's run, are ready to, or wait for a disk; None: not counted.
    """

    state: str
    cpu_ns: int
    rss_bytes: int
    threads: int
    fds: int | None = None
    loop: ThreadSample | None = None
    writer: ThreadSample | None = None
    beat: ThreadSample | None = None
    deciding: tuple[tuple[int, ThreadSample], ...] = ()
    busy: int | None = None


class StackFrame(msgspec.Struct, frozen=True):
    """One frame of a thread. `names` are the locals that may be shown: plain ids, and what a lock's frame says."""

    function: str
    file: str
    line: int
    names: tuple[tuple[str, str], ...] = ()


class ThreadStack(msgspec.Struct, frozen=True):
    """One thread's frames, the innermost first."""

    tid: int
    name: str
    active: bool
    owns_gil: bool
    frames: tuple[StackFrame, ...]


class LockHolder(msgspec.Struct, frozen=True):
    """A process that holds the store's write lock; pid 0: one that this machine's view does not name."""

    pid: int
    name: str
    ours: bool = False  # it is the core itself


class DiskFacts(msgspec.Struct, frozen=True):
    """The data folder's file system, looked at from a thread of our own.

    `write_ns` is what our own small write with its fsync took; None while it has not come back, and then
    `pending_ns` is how long it has been under way. `fault` is its error's name (ENOSPC, EROFS …), else empty.
    """

    free_bytes: int
    read_only: bool
    write_ns: int | None
    pending_ns: int = 0
    fault: str = ""
    size_bytes: int = 0  # of the whole file system; 0: nobody says


class Conduct(msgspec.Struct, frozen=True):
    """What an outside guard would call tampering, each as a fact in words; empty: nothing strange."""

    children: tuple[str, ...] = ()
    code: tuple[str, ...] = ()
    ports: tuple[str, ...] = ()
    jumps: tuple[str, ...] = ()


class LogCounts(msgspec.Struct, frozen=True):
    """What one life has written to its log so far, by weight."""

    warnings: int
    errors: int
