"""Breaks this core on purpose, so that its owner can watch it come back.

A drill is the real fault, not a picture of it: the process aborts, computes for ever, holds the interpreter or
waits for a lock that nobody gives back exactly as it would in an accident, and nothing in the recovery can tell
the difference. Most happen on the thread of the event loop; those that are faults of a command run as one, on
the writer's thread (`BY_COMMAND`). `gc` is the one that must be survived: a healthy core that looks ill. The one
way in is the core's control socket, which only its owner can open; whether drills are allowed is the guard's
policy.
"""

import ctypes
import gc
import os
import signal
import threading
import time
from collections.abc import Callable, Mapping
from enum import StrEnum
from functools import partial
from typing import Final, NoReturn

from core.guarded.locks import NamedLock

#: How long `block` and `slow-tx` wait: longer than any guard does.
BLOCK_S: Final = 86_400
EXIT_CODE: Final = 3
OOM_STEP_BYTES: Final = 8 << 20
#: The guard's memory limit is far below it. Whoever gets here has none, and the machine is not to fall over.
OOM_BYTES_MAX: Final = 4 << 30
#: What a collection costs are the references it follows to places far apart: so many objects with so many each take
#: Objects of the long collections: they take some 300 MB for some seconds, and each collection half a second.
GC_OBJECTS: Final = 3_000_000
GC_COLLECTIONS: Final = 3
_GC_STRIDE: Final = 1_048_573  # a prime: memory that is read in leaps is what makes a collection long
#: The thread that takes part in a deadlock has begun long before, on any machine.
_HANDSHAKE_S_MAX: Final = 10.0
_MUTEX_BYTES: Final = 128  # more than a mutex has on any machine
#: What a leak takes at most where the guard has set no limit.
LEAK_BYTES_MAX: Final = 1 << 30
_LEAK_STEPS_PER_S: Final = 10


class Drill(StrEnum):
    """The faults a core can make by itself."""

    CRASH = "crash"  # a fatal signal of its own
    SEGV = "segv"  # an access to memory that is not there
    EXIT = "exit"  # leaves without being asked and without a word
    FREEZE = "freeze"  # stopped as a whole, as by a debugger
    BLOCK = "block"  # the event loop waits, everything else goes on
    SPIN = "spin"  # the event loop computes for ever
    GIL = "gil"  # C code waits for ever and holds the interpreter meanwhile
    SLOW_TX = "slow-tx"  # a command is decided for ever
    DEADLOCK = "deadlock"  # a command and another thread wait for each other's lock
    OOM = "oom"  # takes memory until the kernel ends it
    DISKFULL = "diskfull"  # the store takes no write for a while
    DBLOCK = "dblock"  # somebody else holds the store's lock; the core only asks for it, and goes on asking
    GC = "gc"  # a long collection, which is no fault
    LEAK = "leak"  # takes memory slowly and keeps it
    STALL = "stall"  # one component no longer gets on, everything else does


def _freeze() -> None:
    os.kill(os.getpid(), signal.SIGSTOP)


def _spin() -> NoReturn:
    turns = 0
    while True:
        turns += 1


def _hold_interpreter() -> None:
    """Wait for ever in C for a mutex that this very thread has, and let no other thread run Python.

    Not a sleep: the signal by which a guard asks for stacks would end it, and a call that is made again lets
    others run in between.
    """
    mutex = ctypes.create_string_buffer(_MUTEX_BYTES)  # all zero: free, and not to be taken twice
    libc = ctypes.PyDLL(None)
    libc.pthread_mutex_lock(mutex)
    libc.pthread_mutex_lock(mutex)


def _embrace() -> None:
    """Take one lock while another thread takes the other, then want the other's, as it wants ours."""
    ours, theirs = NamedLock("drill.ours"), NamedLock("drill.theirs")
    with ours:
        their_turn = threading.Event()
        _in_background(partial(_embrace_back, ours, theirs, their_turn))
        assert their_turn.wait(_HANDSHAKE_S_MAX), "the other thread never began"
        with theirs:
            pass


def _embrace_back(ours: NamedLock, theirs: NamedLock, their_turn: threading.Event) -> None:
    with theirs:
        their_turn.set()
        with ours:
            pass


def _eat_memory() -> None:
    eaten: list[bytes] = []
    while len(eaten) * OOM_STEP_BYTES < OOM_BYTES_MAX:
        eaten.append(b"\x01" * OOM_STEP_BYTES)  # not zeros: memory that nobody has written to is not there


def _collect_much() -> None:
    """Make a heap of millions of objects, each naming another far from it, collect, and forget it."""
    heap: list[list[object]] = [[] for _ in range(GC_OBJECTS)]
    for place, made in enumerate(heap):
        made.append(heap[place * _GC_STRIDE % GC_OBJECTS])
    for _ in range(GC_COLLECTIONS):
        gc.collect()
    for made in heap:
        made.clear()  # they name each other in circles, and would be there until a collection finds them


def _in_background(run: Callable[[], None]) -> None:
    # A daemon: what a drill has left behind must not keep the process from leaving.
    threading.Thread(target=run, name="drill", daemon=True).start()


class Leak:
    """Memory that is taken a little at a time, written to and kept, until somebody stops it or the process ends."""

    def __init__(self) -> None:
        """Prepare; nothing is taken yet."""
        self._stop = threading.Event()

    def begin(self, mb_per_s: int, seconds: int, bytes_max: int) -> None:
        """Take so much a second for so long, `bytes_max` at most, beside everything else; 0 gives all of it back."""
        self._stop.set()
        self._stop = threading.Event()
        if mb_per_s:
            _in_background(
                partial(self._take, self._stop, (mb_per_s << 20) // _LEAK_STEPS_PER_S, seconds, bytes_max)
            )

    @staticmethod
    def _take(stop: threading.Event, step_bytes: int, seconds: int, bytes_max: int) -> None:
        taken: list[bytes] = []
        for _ in range(min(seconds * _LEAK_STEPS_PER_S, bytes_max // step_bytes)):
            taken.append(b"\x01" * step_bytes)  # not zeros, as above
            if stop.wait(1 / _LEAK_STEPS_PER_S):
                return
        stop.wait()  # what has leaked stays


#: What happens at once, on the thread of the event loop. It returns where the fault is elsewhere or was healed.
AT_ONCE: Final[Mapping[Drill, Callable[[], object]]] = {
    Drill.CRASH: os.abort,
    Drill.SEGV: partial(ctypes.string_at, 0),
    Drill.EXIT: partial(os._exit, EXIT_CODE),
    Drill.FREEZE: _freeze,
    Drill.BLOCK: partial(time.sleep, BLOCK_S),
    Drill.SPIN: _spin,
    Drill.GIL: _hold_interpreter,
    Drill.OOM: partial(_in_background, _eat_memory),
    Drill.GC: partial(_in_background, _collect_much),
}

#: Faults of a command: the writer's thread runs them in the place and the stage of a real one. None: the command
#: itself does nothing, the fault is what it meets.
BY_COMMAND: Final[Mapping[Drill, Callable[[], object] | None]] = {
    Drill.SLOW_TX: partial(time.sleep, BLOCK_S),
    Drill.DEADLOCK: _embrace,
    Drill.DISKFULL: None,
    Drill.DBLOCK: None,
}

#: Faults that go on beside everything else: they come with numbers or a name of their own.
BESIDE: Final = frozenset({Drill.LEAK, Drill.STALL})
