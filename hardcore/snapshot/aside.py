"""A look at the kernel that may take its time or never come back, on a thread of its own.

A read of /proc can't be given a timeout: the roll-up of a memory map waits for a lock that a stuck process may
hold, and the table of locks for all processors to have passed by, which took 200 ms on a busy machine. So such
a look is begun early, goes on beside everything else and is waited for at the end, as long as it is worth. One
that hangs is left behind; a few such threads at most, then nobody asks any more. The caller's pool was not
chosen: its threads are those that start the next core.
"""

import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar

#: Looks that may be under way at one time, in the whole process.
LOOKS_MAX = 8

T = TypeVar("T")

#: Of the whole process and not of one evidence: what hangs there outlives it.
_under_way = threading.BoundedSemaphore(LOOKS_MAX)


class Aside(Generic[T]):
    """A look that is under way from the moment it is made. It is to tell what it can't see as a value."""

    def __init__(self, look: Callable[[], T]) -> None:
        self._found: list[T] = []
        self._over = threading.Event()
        self._begun = _under_way.acquire(blocking=False)
        if self._begun:
            threading.Thread(target=self._run, args=(look,), name="aside", daemon=True).start()

    def wait(self, until_ns: int) -> T | str:
        """Return what was found, or why there is nothing until this moment (monotonic nanoseconds)."""
        if not self._begun:
            return f"{LOOKS_MAX} earlier looks hang in the kernel"
        if not self._over.wait(max(0.0, (until_ns - time.monotonic_ns()) / 1e9)):
            return "the kernel did not answer in time"
        return self._found[0] if self._found else "the look at it failed"

    def _run(self, look: Callable[[], T]) -> None:
        try:
            self._found.append(look())
        finally:
            _under_way.release()
            self._over.set()
