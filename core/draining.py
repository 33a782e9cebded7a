"""Draining: a core that is to be followed by another finishes what it has and lets go of the store.

First the imports and uploads, while the ledger still answers the questions they ask; then everything that holds a
slot; then the connection that writes. Until that is closed all of it can be taken back, and it is, if the time is not
enough: an order to drain may cost a moment, and never a request. What is stuck is not waited for on the way back
either. Afterwards nothing is committed by this process any more, whoever thaws or wakes it: it only waits for TERM,
with the sockets of open pages in its hand. Not chosen: leaving at once, as for a TERM; the successor would be waited
for by everybody, and a successor that never comes could not be undone.
"""

import asyncio
from collections.abc import Callable
from typing import Final, NoReturn

from core.guarded.recorder import FlightRecorder, LifeState
from core.imports.desk import Desk
from core.journal.writer import Writer
from core.service import Service

LOOK_EVERY_S: Final = 0.001
CLOSING_S: Final = 1.0
LEAVING: Final = "The core is leaving."


class Drain:
    """The draining of one life. All methods on the loop's thread."""

    def __init__(
        self,
        service: Service,
        desk: Desk,
        writer: Writer | None,
        recorder: FlightRecorder,
        on_let_go: Callable[[], None],
        on_stuck: Callable[[], NoReturn],
    ) -> None:
        """Take the parts. `writer` None: this core was started to read only.

        `on_let_go` is called once the store is closed; `on_stuck`, which must end the process, where it can neither
        be closed nor used again.
        """
        self._service = service
        self._desk = desk
        self._writer = writer
        self._recorder = recorder
        self._on_let_go = on_let_go
        self._on_stuck = on_stuck
        self._under_way = False
        self._drained = False
        self._leaving = False

    def leave(self) -> None:
        """Take nothing back any more: this core leaves, drained or not."""
        self._leaving = True

    async def within(self, within_ms: int) -> int | str:
        """Drain and return the last sequence, or why that could not be done: then requests are taken as before."""
        if self._drained:
            return self._service.head_seq
        if self._is_leaving():
            return LEAVING
        if self._under_way:
            return "An earlier order to drain is being carried out."
        self._under_way = True
        self._recorder.set_state(LifeState.DRAINING)
        try:
            missing = await self._drain(asyncio.get_running_loop().time() + within_ms / 1000)
        finally:
            self._under_way = False
        if self._is_leaving():
            return LEAVING
        if missing is not None:
            self._take_back(missing)
            return missing
        self._drained = True
        self._service.lay_down()
        self._on_let_go()
        return self._service.head_seq

    async def _drain(self, until_s: float) -> str | None:
        """Return what was not done in time, None if all is."""
        missing = "imports and uploads are at work"
        try:
            async with asyncio.timeout_at(until_s):
                if self._writer is not None:
                    await self._desk.rest()
                self._service.pause()
                missing = "requests are not answered"
                await self._service.until_answered()
        except TimeoutError:
            return f"Not drained in time: {missing}."
        return None if self._writer is None else await self._close(self._writer, until_s)

    async def _close(self, writer: Writer, until_s: float) -> str | None:
        """Close the connection that writes."""
        writer.ask_to_stop()
        if await _ended(writer, until_s):
            return None
        if self._is_leaving() or writer.go_on():
            return "Not drained in time: the writer is not done."
        if not await _ended(writer, until_s + CLOSING_S):
            self._on_stuck()
        return None

    def _is_leaving(self) -> bool:
        return self._leaving

    def _take_back(self, reason: str) -> None:
        self._recorder.event("UNDRAINED", reason)
        self._service.resume()
        if self._writer is not None:
            self._desk.go_on()
        self._recorder.set_state(LifeState.READY)


async def _ended(writer: Writer, until_s: float) -> bool:
    """Look until the writer's thread has ended. A thread's end wakes nobody, and a join could not be called off."""
    loop = asyncio.get_running_loop()
    while writer.is_alive and loop.time() < until_s:  # noqa: ASYNC110
        await asyncio.sleep(LOOK_EVERY_S)
    return not writer.is_alive
