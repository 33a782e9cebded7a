"""A piece of blocking work that may hang, run beside whoever wants its result, never twice at a time.

Each run has a thread of its own that ends with it: what hangs in the kernel costs one thread, and the next run is
simply not begun. A pool was not chosen: one hanging worker would hold up the work of others, and that somebody
hangs is just what is to be seen here.
"""

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Errand(Generic[T]):
    """Runs `work` on a thread named `name` each time it is sent and not under way. Used from one thread.

    `work` raises nothing; what goes wrong outside is part of its result.
    """

    def __init__(self, name: str, work: Callable[[], T]) -> None:
        self._name = name
        self._work = work
        self._began_ns: int | None = None
        self._done = threading.Event()
        self._fresh: list[T] = []
        self.last: T | None = None

    def send(self, now_ns: int) -> None:
        """Begin the work, unless it is under way. Raises RuntimeError when no thread can be made."""
        self._settle()
        if self._began_ns is not None:
            return
        self._done.clear()
        threading.Thread(target=self._run, name=self._name, daemon=True).start()
        self._began_ns = now_ns

    def back(self, within_s: float) -> bool:
        """Wait for the work at most so long; return whether nothing is under way (any more)."""
        if self._began_ns is not None:
            self._done.wait(within_s)
        return self._settle()

    def pending_ns(self, now_ns: int) -> int:
        """Return how long the work has been under way; 0 when none is."""
        return 0 if self._settle() or self._began_ns is None else max(1, now_ns - self._began_ns)

    def _settle(self) -> bool:
        if self._began_ns is not None and self._done.is_set():
            self._began_ns = None
            self.last = (
                self._fresh.pop() if self._fresh else None
            )  # none: it has raised, which is our own bug
        return self._began_ns is None

    def _run(self) -> None:
        try:
            self._fresh.append(self._work())
        finally:
            self._done.set()
