"""Locks that say who waits for whom: a thread that waits for one shows it to any reader of its stack.

A deadlock is seen from outside as a cycle of such threads, so the wait has a frame of its own whose locals are
plain words: the lock's name and the thread that has it. A free lock costs one try and one store more than a
bare one. While it waits, the thread wakes now and then and looks again who has the lock: a dump taken later
must not name an owner of long ago. Not chosen: a registry of all locks; it would itself need a lock, and
memory that only a living interpreter could read out.
"""

import threading
from types import TracebackType
from typing import Final

#: How old the name of the owner in a waiting frame can be.
LOOK_AGAIN_S: Final = 0.25


class NamedLock:
    """A lock that is taken by one thread and given back by the same; it may not be taken twice."""

    def __init__(self, name: str) -> None:
        """Make a free lock. `name` is what a dump shows: the thing it protects."""
        self.name = name
        self._lock = threading.Lock()
        self._owner = 0

    @property
    def held_by(self) -> str:
        """The thread that has it, as the kernel numbers threads; empty if nobody does."""
        return str(self._owner) if self._owner else ""

    def take(self, within_s: float) -> bool:
        """Take it if it comes free within this time (0: only if it is free now); return whether it did."""
        taken = self._lock.acquire(blocking=within_s > 0, timeout=within_s if within_s > 0 else -1)
        if taken:
            self._owner = threading.get_native_id()
        return taken

    def __enter__(self) -> None:
        """Take it, however long that takes."""
        if not self.take(0):
            wait_for_lock(self)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give it back."""
        self._owner = 0
        self._lock.release()


def wait_for_lock(lock: NamedLock) -> None:
    """Take a lock that somebody else has. The name of this function and its locals are a wire (section 4)."""
    lock_name: str = lock.name  # noqa: F841  for stack dumps
    held_by: str = lock.held_by
    while not lock.take(LOOK_AGAIN_S):
        held_by = lock.held_by  # noqa: F841  for stack dumps
