"""The exporter: the component that reads the whole book for a person who takes it along.

An export is of one moment and may take minutes, because a client takes it as slowly as it likes; so it is read in slices,
each when the one before was taken, and none holds a read open. It takes no slot, for the reasons of the auditor's: it
has this component's beat, while a slice is read and not while a client is waited for, and a bound of its own. A slice is
a question, so where reading hangs it is begun anew and whoever downloads notices nothing.
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Final, TypeVar

from sqlalchemy import Connection, Engine
from sqlalchemy.exc import DBAPIError

from core.alone import Turns
from core.guarded.recorder import FlightRecorder
from core.journal.exporting import Exported, Moment, moment, slice_after
from core.journal.store import StoreError, beside, snapshot, store_error
from core.rulings import Rulings
from core.settings import Settings

T = TypeVar("T")

EXPORTS_MAX: Final = 2
EXPORTER: Final = "exporter"  # its name on the recorder page
SILENT_MS_MAX: Final = 10_000  # for a slice, which ends by itself long before


class ExportBrokenError(Exception):
    """An export ends before its end: the client sees a transfer that was cut off, and no whole file."""


class Exporter:
    """The component. All methods on the loop's thread."""

    def __init__(
        self, readers: Engine, recorder: FlightRecorder, settings: Settings, rulings: Rulings
    ) -> None:
        """Prepare."""
        self._readers = beside(readers)
        self._settings = settings
        self._rulings = rulings
        self._turns = Turns(EXPORTER, recorder.component(EXPORTER, SILENT_MS_MAX))
        self._exports = 0
        self._drills: set[asyncio.Task[object]] = set()

    @contextmanager
    def place(self) -> Iterator[bool]:
        """Take the place of one export until its end; False where all are taken."""
        if self._exports >= EXPORTS_MAX:
            yield False
            return
        self._exports += 1
        try:
            yield True
        finally:
            self._exports -= 1

    async def now(self) -> Moment | StoreError:
        """Return the moment that an export begun now is of."""
        return await self._ask(partial(moment, parked=self._rulings.quarantine.rules.parked))

    async def slices(self, of: Moment, is_leaving: Callable[[], bool]) -> AsyncIterator[list[Exported]]:
        """Give all transactions up to a moment, slice by slice; raises ExportBrokenError where that can't be done."""
        seq = 0
        parked = self._rulings.quarantine.rules.parked
        while seq < of.seq:
            if is_leaving():
                raise ExportBrokenError("the core is leaving")
            found = await self._ask(partial(slice_after, after_seq=seq, until_seq=of.seq, parked=parked))
            if isinstance(found, StoreError):
                raise ExportBrokenError(found.text)
            if not found:
                return
            yield found
            seq = found[-1].seen.seq

    def begin_anew(self) -> None:
        """Leave a slice that hangs behind; it is read again for whoever waits for it."""
        self._turns.begin_anew()

    def stall(self) -> None:
        """Have a slice come to no end: a drill."""
        self._turns.stall()
        if not self._turns.is_busy:
            task = asyncio.create_task(self.now(), name=EXPORTER)
            self._drills.add(task)
            task.add_done_callback(self._drills.discard)

    async def end(self) -> None:
        """Wait until no slice is being read, once nobody asks for any more."""
        await self._turns.end()

    async def _ask(self, question: Callable[[Connection], T]) -> T | StoreError:
        def ask(_: Callable[[], None]) -> T | StoreError:
            try:
                with snapshot(self._readers, self._settings.read_ms_max) as connection:
                    return question(connection)
            except DBAPIError as error:
                return store_error(error)

        return await self._turns.do(ask)
