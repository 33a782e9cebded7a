"""Slots: every piece of work holds one on the recorder before it may run, and while a core drains nothing new is taken.

No slot, no execution: their number is the bound of every queue behind this room, and what stands in one is what a guard
finds after a death. Everything here lives on the event loop's thread. Not chosen: a slot for each protocol's own kind of
work; whoever looks from outside would have to know them all.
"""

import asyncio
import os
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import msgspec

from core.guarded.recorder import FlightRecorder, Stage
from core.ledger.ids import ENTROPY_BYTES, uuid7
from core.limits import limit_ms
from core.rulings import Rulings
from core.settings import Settings

IDS_AHEAD: Final = 256  # whose randomness is asked for at once
UNANSWERED: Final = 500  # noted of work that ended without an answer


class Held(msgspec.Struct):
    """A slot while its work goes on. `status`: what the work was answered with, as soon as that is known."""

    slot: int
    status: int = UNANSWERED


class NoSlot:
    """Every slot is taken: the work was not begun."""


class Draining:
    """The core is leaving: the work was not begun."""


class Slots:
    """Who is at work: every piece of work holds a slot on the recorder, and while a core drains nothing new is taken.

    All methods on the loop's thread.
    """

    def __init__(self, recorder: FlightRecorder, settings: Settings, rulings: Rulings) -> None:
        """Take work from now on."""
        self.settings = settings
        self.rulings = rulings
        self._recorder = recorder
        self._draining = False
        self._laid_down = False
        self._in_flight = 0
        self._ahead: deque[bytes] = deque()
        self._all_answered = asyncio.Event()
        self._all_answered.set()
        self.leaving = threading.Event()

    @property
    def in_flight(self) -> int:
        """How many requests hold a slot."""
        return self._in_flight

    @property
    def draining(self) -> bool:
        """Whether nothing new is taken any more."""
        return self._draining

    @property
    def is_laid_down(self) -> bool:
        """Whether this core has let go of its book for good, and only waits to be ended."""
        return self._laid_down

    def new_id(self) -> str:
        """Return a new UUIDv7. Any thread."""
        return uuid7(time.time_ns() // 1_000_000, self._entropy())

    def _entropy(self) -> bytes:
        # Asked for ahead: who asks the system lets go of the interpreter, and has to wait for it behind a busy writer.
        try:
            return self._ahead.pop()
        except IndexError:
            raw = os.urandom(ENTROPY_BYTES * IDS_AHEAD)
            self._ahead.extend(raw[at : at + ENTROPY_BYTES] for at in range(0, len(raw), ENTROPY_BYTES))
            return os.urandom(ENTROPY_BYTES)

    def begin(
        self,
        kind: str,
        payload: bytes,
        *,
        key: str | None = None,
        name: str = "",
        command_id: str = "",
        transaction_id: str = "",
        account_ids: tuple[str, ...] = (),
    ) -> int | NoSlot | Draining:
        """Note work on the recorder and return its slot. Each slot must be given to `finish`.

        `name`: what a guard calls work that has no key.
        """
        if self._draining:
            return Draining()
        limit_ns = limit_ms(kind, self.settings, self.rulings.quarantine.rules.deadlines_ms) * 1_000_000
        slot = self._recorder.begin(
            command_id or self.new_id(), key, kind, transaction_id, account_ids, payload, limit_ns, name
        )
        if slot is None:
            return NoSlot()
        self._in_flight += 1
        self._all_answered.clear()
        return slot

    def answering(self, slot: int) -> None:
        """Say that the answer is on its way."""
        self._recorder.stage(slot, Stage.ANSWERING)

    def finish(self, slot: int, status: int) -> None:
        """Free a slot whose request was answered with this status."""
        self._recorder.finish(slot, status)
        self._in_flight -= 1
        if self._in_flight == 0:
            self._all_answered.set()

    def pause(self) -> None:
        """Take nothing new until `resume`."""
        self._draining = True

    def resume(self) -> None:
        """Take requests again, unless this core is leaving."""
        self._draining = self.leaving.is_set()

    async def until_answered(self) -> None:
        """Wait until every request that holds a slot is answered."""
        await self._all_answered.wait()

    async def all_answered(self, within_ms: int) -> bool:
        """Wait until every request that holds a slot is answered; return whether that came about."""
        try:
            await asyncio.wait_for(self.until_answered(), within_ms / 1000)
        except TimeoutError:
            return False
        return True


@contextmanager
def holding_slot(
    service: Slots,
    kind: str,
    payload: bytes,
    *,
    key: str | None = None,
    name: str = "",
    command_id: str = "",
    transaction_id: str = "",
    account_ids: tuple[str, ...] = (),
) -> Iterator[Held | NoSlot | Draining]:
    """Hold a slot for a piece of work, where there is one to be had, and free it however the work ends."""
    slot = service.begin(
        kind,
        payload,
        key=key,
        name=name,
        command_id=command_id,
        transaction_id=transaction_id,
        account_ids=account_ids,
    )
    if not isinstance(slot, int):
        yield slot
        return
    held = Held(slot)
    try:
        yield held
    finally:
        service.finish(slot, held.status)
