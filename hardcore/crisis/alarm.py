"""One deadline that is set far more often than it rings.

Each request sets a limit of seconds and is answered within a millisecond. Moving a deadline later here
only notes the new time; the timer beneath wakes, sees that it is early, and sleeps on. A timer made and
cancelled for each request was measured as a visible part of the gateway's work.
"""

import asyncio
from collections.abc import Callable


class Alarm:
    """Calls `ring` once when its time is over, unless it was set anew or cleared."""

    __slots__ = ("_due", "_handle", "_loop", "_ring", "_wakes")

    def __init__(self, loop: asyncio.AbstractEventLoop, ring: Callable[[], None]) -> None:
        self._loop = loop
        self._ring = ring
        self._due: float | None = None
        self._wakes = 0.0
        self._handle: asyncio.TimerHandle | None = None

    def set(self, delay_ms: float) -> None:
        """Ring in `delay_ms`; replaces what was set before."""
        due = self._loop.time() + delay_ms / 1000
        self._due = due
        if self._handle is not None:
            if self._wakes <= due:
                return
            self._handle.cancel()
        self._sleep_until(due)

    def clear(self) -> None:
        """Do not ring. The timer beneath runs out by itself."""
        self._due = None

    def close(self) -> None:
        """Do not ring, and let go of everything."""
        self._due = None
        if self._handle is not None:
            self._handle.cancel()
            self._handle = None

    def _sleep_until(self, due: float) -> None:
        self._wakes = due
        self._handle = self._loop.call_at(due, self._wake)

    def _wake(self) -> None:
        self._handle = None
        due = self._due
        if due is None:
            return
        if due > self._loop.time():
            self._sleep_until(due)
            return
        self._due = None
        self._ring()
