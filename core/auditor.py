"""The auditor: the component that proves the whole book (proof B), for whoever asks and once for nobody.

One proof runs at a time. Whoever asks meanwhile waits for the next one, all for the same: the one that runs has
passed events that they may be asking about. A proof takes no slot, because it may honestly take minutes and a guard
would read a slot without progress as a hang; it has this component's beat, one for each slice, and where that stops
it is begun anew. It is a question and changes nothing, so who waits for it waits on.
"""

import asyncio
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Final

import msgspec
from sqlalchemy import Engine

from core.alone import LeftBehindError, Turns
from core.guarded.recorder import FlightRecorder
from core.journal.rebuilding import Rebuilding
from core.journal.store import StoreError, beside
from core.journal.verify import GivenUp, Verdict, verify
from core.settings import Settings
from core.slots import Draining, NoSlot

WAITING_MAX: Final = 16
AUDITOR: Final = "auditor"  # its name on the recorder page
SILENT_MS_MAX: Final = 30_000  # for a slice, or for the readings of the whole book behind the last one


class Proven(msgspec.Struct, frozen=True):
    """A proof that found the book whole: when it ended (monotonic ns), and how many events there were."""

    at_ns: int
    events: int


class Auditor:
    """The component. All methods on the loop's thread."""

    def __init__(
        self,
        readers: Engine,
        recorder: FlightRecorder,
        settings: Settings,
        rebuilding: Rebuilding,
        leaving: threading.Event,
    ) -> None:
        """Prepare. `leaving` is set once this core gives up what nobody needs any more."""
        self._readers = beside(readers)
        self._settings = settings
        self._rebuilding = rebuilding
        self._leaving = leaving
        self._turns = Turns(AUDITOR, recorder.component(AUDITOR, SILENT_MS_MAX))
        self._proving = asyncio.Lock()
        self._next: asyncio.Task[Verdict | StoreError | GivenUp] | None = None
        self._waiting = 0
        self._drills: set[asyncio.Task[object]] = set()
        self.proven: Proven | None = None  # the newest proof of this core that found the book whole

    async def verify(self) -> Verdict | StoreError | NoSlot | Draining:
        """Prove the whole book as it stands after this call."""
        if self._waiting >= WAITING_MAX:
            return NoSlot()
        if self._next is None:
            self._next = asyncio.create_task(self._prove())
        self._waiting += 1
        try:
            verdict = await asyncio.shield(self._next)
        finally:
            self._waiting -= 1
        return Draining() if isinstance(verdict, GivenUp) else verdict

    async def verify_behind(self) -> Verdict | StoreError | GivenUp:
        """Prove the whole book for nobody who waits: it rests between slices, and gives way to whoever asks."""
        rest_s = self._settings.verify_rest_ms / 1000
        gives_way = partial(self._replay, lambda: self._leaving.wait(0.0 if self._waiting else rest_s))
        async with self._proving:
            return self._noted(await self._turns.do(gives_way))

    def _noted(self, found: Verdict | StoreError | GivenUp) -> Verdict | StoreError | GivenUp:
        if isinstance(found, Verdict) and found.ok:
            self.proven = Proven(time.monotonic_ns(), found.events)
        return found

    def begin_anew(self) -> None:
        """Leave a proof that hangs behind; whoever waits for it gets another."""
        self._turns.begin_anew()

    def stall(self) -> None:
        """Have a proof come to no end between two slices, where it holds nothing of the store."""
        self._turns.stall()
        if not self._turns.is_busy:
            task = asyncio.create_task(self.verify(), name=AUDITOR)
            self._drills.add(task)
            task.add_done_callback(self._drills.discard)

    async def end(self) -> None:
        """Wait until no proof is at work, once it was given up."""
        await self._turns.end()

    async def _prove(self) -> Verdict | StoreError | GivenUp:
        async with self._proving:
            self._next = None  # who asks from now on needs another one
            return self._noted(await self._turns.do(partial(self._replay, self._leaving.is_set)))

    def _replay(
        self, is_leaving: Callable[[], bool], go_on: Callable[[], None]
    ) -> Verdict | StoreError | GivenUp:
        def between_slices() -> bool:
            go_on()
            return is_leaving()

        try:
            return verify(self._readers, self._settings.read_ms_max, between_slices, self._rebuilding)
        except LeftBehindError:
            return GivenUp()
