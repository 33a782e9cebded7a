"""Tenure: whether this core may still speak for the book, asked after every moment in which it may have been stopped.

A process that was frozen knows nothing of it: it goes on in the middle of a line, perhaps minutes later, with another
core at work. Its writes are safe, because each transaction looks at the epoch itself, and its answers carry an old
epoch, which a gateway discards. What is left is a core that would go on reading to whoever asks it directly. So
where its own beat shows a gap, the store is asked for its epoch before anything more is answered. Not chosen: a look
before every answer; it would cost each of them a read of the store for something that happens once in a year.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import Final

#: Ten beats. A guard that follows somebody it can't end waits for longer than that; and a doubt costs one short read.
STOPPED_NS: Final = 250_000_000


class Tenure:
    """The tenure of one core. Used on the loop's thread."""

    def __init__(
        self, epoch: int, ask: Callable[[], Awaitable[int | None]], on_over: Callable[[int], object]
    ) -> None:
        """Begin now. `ask` returns the store's epoch, None if it can't be read; `on_over` is told a higher one."""
        self._epoch = epoch
        self._ask = ask
        self._on_over = on_over
        self._seen_ns = time.monotonic_ns()
        self._stops = 0
        self._asking: asyncio.Task[None] | None = None
        self._laid_down = False

    def beat(self, now_ns: int) -> None:
        """Say that the loop runs at this moment; a gap since the last one is doubt."""
        if now_ns - self._seen_ns > STOPPED_NS and not self._laid_down:
            self._stops += 1
            if self._asking is None:
                self._asking = asyncio.get_running_loop().create_task(self._look())
        self._seen_ns = now_ns

    async def sure(self) -> None:
        """Return once there is no doubt. The first answer after a stop may come before the first beat."""
        self.beat(time.monotonic_ns())
        if self._asking is not None:
            await asyncio.shield(self._asking)

    def lay_down(self) -> None:
        """Speak for the book no more: that another core does is then as it should be, and nobody is told."""
        self._laid_down = True

    async def _look(self) -> None:
        try:
            seen = 0
            # A stop while somebody looks may lie behind the moment in which the epoch was read.
            while seen < self._stops and not self._laid_down:
                seen = self._stops
                actual = await self._ask()
                if actual is not None and actual > self._epoch and not self._laid_down:
                    self._on_over(actual)
                    return
        finally:
            self._asking = None
