"""Ends what an earlier guard left behind, and tells when nothing of it lives any more.

All of it together is one life, number 0, with one end: which of them was the last core that wrote is known from their
pages and not from the order in which they die. There is no time limit on it: what hangs in the kernel may end in
hours, and only then may a core begin.
"""

import asyncio
import signal
from collections.abc import Awaitable, Callable
from typing import Any

from hardcore.host import clock
from hardcore.host.lives import KILL_S, Life
from hardcore.host.processes import Handle, gone
from hardcore.model import observations as seen


class Clearing:
    """Ends `leftovers`. `tell` takes the facts, on the loop; `in_hand` runs blocking work on a hand's thread."""

    def __init__(
        self, tell: Callable[[seen.Observation], None], in_hand: Callable[..., Awaitable[Any]]
    ) -> None:
        self.leftovers: tuple[Life, ...] = ()
        self._tell = tell
        self._in_hand = in_hand
        self._waits = False
        self._living = 0

    async def see_off(self, handle: Handle) -> None:
        """End a process of the earlier guard that nobody hears any more, a court."""
        try:
            await self._in_hand(handle.kill_tree)
            await gone(handle, KILL_S)
        finally:
            handle.close()

    async def kill(self) -> None:
        """Kill all of them; it is asked again while one does not die, and then only kills again."""
        handles = [life.handle for life in self.leftovers if life.handle is not None]
        for handle in handles:
            await self._in_hand(handle.kill_tree)
        if self._waits:
            return
        self._waits = True
        self._living = len(handles)
        for handle in handles:
            asyncio.get_running_loop().add_reader(handle.pidfd, self._ended, handle)
        if not handles:
            self._over()

    def _ended(self, handle: Handle) -> None:
        asyncio.get_running_loop().remove_reader(handle.pidfd)
        self._living -= 1
        if not self._living:
            self._over()

    def _over(self) -> None:
        """Nothing of the earlier guard's lives any more: take over what its cores left."""
        handles = [life.handle for life in self.leftovers if life.handle is not None]
        pages = [page for life in self.leftovers if (page := life.page()) is not None]
        last = max(pages, key=lambda page: page.beats.epoch, default=None)
        for life in self.leftovers:
            life.let_go()
        self.leftovers = ()
        # Without a process there was nothing to kill: how that core ended, nobody saw.
        how = seen.Exit(signal=int(signal.SIGKILL)) if handles else seen.Exit()
        self._tell(seen.CoreExited(clock.now_ns(), 0, how, last))
