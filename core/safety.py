"""Reading only: how a living core stops taking writes, and how it takes them again.

Three may say so: the store, when it takes a write no longer, the writer, when the book is not one to be written on, and
the guard, when it sees from outside that a restart would not help. What stands in the writer's line then is finished; what comes later is refused before it is begun,
and reads go on. The way back is a write without effect: only a store that has committed one is believed. A core
that nobody guards tries that by itself from time to time; not with a damaged book, which no time makes whole. One that was started to read only has no writer, and no
way back: another core has to be started. Not chosen: one flag inside the writer's thread, because whoever asks
during a stalled write must be refused at once.
"""

import asyncio
import logging
from typing import Final, NoReturn, assert_never

from core import departure
from core.guarded.beacon import Beacon
from core.guarded.recorder import FlightRecorder
from core.journal.answers import (
    Answer,
    DecisionFailed,
    Done,
    Each,
    KeyTaken,
    KeyUnknown,
    Leaving,
    Limited,
    OutcomeUnknown,
    ReadOnly,
    Refused,
    SetAside,
    StoreBusy,
    Touch,
)
from core.journal.append import WHY_NOT
from core.journal.store import StoreError, StoreFault
from core.journal.writer import Writer
from core.service import Service
from core.slots import Draining, NoSlot

TOUCH: Final = "store.touch"
NOT_DONE: Final = 503

logger = logging.getLogger("core")


class Safety:
    """The switch of one service. All methods on the loop's thread."""

    def __init__(
        self, service: Service, writer: Writer | None, recorder: FlightRecorder, beacon: Beacon
    ) -> None:
        """Take the parts. `writer` None: this core was started to read only."""
        self._service = service
        self._writer = writer
        self._recorder = recorder
        self._beacon = beacon
        self._told = False  # the guard knows of the store's fault from us
        self._unsound = False  # and this of the book's
        self._orders = 0

    def shut(self, error: StoreError) -> None:
        """Take no more writes: one could not be written just now, and nothing of it was done."""
        if error.fault is StoreFault.DAMAGED:
            self._tell_unsound(departure.corrupt(error.text).sentence)
        elif not self._told:
            self._told = True
            self._beacon.store("READ_ONLY" if error.fault is StoreFault.READ_ONLY else "FULL")
        if self._service.safe is None or error.fault is StoreFault.DAMAGED:
            logger.warning("Nothing can be written (%s): this core serves reads only.", error.text)
            self._set(WHY_NOT[error.fault])

    async def switch(self, reason: str | None) -> str | None:
        """Serve reads only because of `reason`, or (None) everything again.

        Return why that could not be done; None: it is done.
        """
        self._orders += 1
        if reason is None:
            return await self._take_writes_again(self._orders)
        self._set(reason)
        return None

    async def keep_trying(self, every_ms: int) -> NoReturn:
        """Try to take writes again, every `every_ms`, for a core that nobody tells to."""
        while True:
            await asyncio.sleep(every_ms / 1000)
            if not self._unsound:
                await self.switch(None)

    async def _take_writes_again(self, order: int) -> str | None:
        if self._service.safe is None:
            return None
        if self._writer is None:
            return "This core was started to read only: start another one."
        slot = self._service.begin(TOUCH, b"")
        if isinstance(slot, NoSlot):
            return "Every slot is taken: there is none to try a write with."
        if isinstance(slot, Draining):
            return "The core is leaving."
        status = NOT_DONE
        try:
            answer = await self._writer.submit(Touch(slot))
            status = answer.status if isinstance(answer, Done) else NOT_DONE
        finally:
            self._service.finish(slot, status)
        fault = _why_not(answer)
        if fault is None and order != self._orders:
            return "Another order came meanwhile."
        if fault is None:
            self._open()
        return fault

    def _tell_unsound(self, sentence: str) -> None:
        if not self._unsound:
            self._unsound = True
            self._beacon.unsound(sentence)
            logger.error("%s", sentence)

    def _open(self) -> None:
        self._set(None)
        if self._told:
            self._told = False
            self._beacon.store("OK")
        self._unsound = False  # somebody has decided so; it is told again where it is met again
        logger.info("The store takes writes again.")

    def _set(self, reason: str | None) -> None:
        if reason != self._service.safe:
            self._recorder.event("SAFE_OFF" if reason is None else "SAFE_ON", reason or "")
        self._service.safe = reason


def _why_not(answer: Answer) -> str | None:
    match answer:
        case Done():
            return None
        case ReadOnly(reason):
            return f"The store still takes no write ({reason})."
        case StoreBusy():
            return "Somebody else holds the store's lock."
        case Leaving() | OutcomeUnknown():
            return "The core is leaving."
        case Each() | Refused() | KeyTaken() | KeyUnknown() | DecisionFailed() | SetAside() | Limited():
            raise AssertionError("a write without effect is not decided")
        case _:
            assert_never(answer)
