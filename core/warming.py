"""The spare: a core that has loaded and read everything, and waits to be promoted.

Nothing that could be done before may be left for the moment in which people wait: all modules, templates, formats and
routes are there, each page was drawn once from the store's own rows for nobody (so that every statement is compiled
and every file read), the connections that read are open, and the proof has walked to the head of the book. It follows
the head with short reads, none of which outlives its moment; an open one would keep the log from being checkpointed. So
where the log has grown long it reads nothing, whoever's fault that is, until it is short again.
It writes nothing and raises no epoch: whoever never promotes it has never had it. Not chosen: forking a warm parent,
because threads, sockets and SQLite's locks are not inherited whole.
"""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Final

import msgspec
from sqlalchemy import Engine
from sqlalchemy.exc import DBAPIError
from starlette.applications import Starlette
from starlette.types import Receive, Scope, Send

from core import departure
from core.departure import Departure
from core.guarded.orders import PromoteOrder
from core.guarded.recorder import FlightRecorder, NoRecorder
from core.imports.desk import Desk
from core.journal import queries, schema
from core.journal.ahead import Ahead
from core.journal.ground import Ground
from core.journal.rehearsal import rehearse_writing
from core.journal.store import (
    LEDGER_FILE,
    StoreError,
    Writing,
    open_reading,
    snapshot,
    store_error,
    writing,
)
from core.loading import be_nice
from core.rulings import Rulings
from core.service import Service, Unwritten
from core.settings import Settings
from core.web.app import lay_out, make_app
from core.web.rehearsal import rehearse

LOOK_EVERY_S: Final = 1.0
SLICE_REST_S: Final = 0.02  # between two slices of the book that have not been seen yet
#: Far above what a log comes to between two checkpoints: somebody's reads keep it from being emptied, and the likeliest
#: reader is a spare on a starved machine. It can always be without them: the proof then has more to do.
LOG_BYTES_MAX: Final = 32 << 20
REHEARSING: Final = "REHEARSING"  # why the service of a rehearsal serves reads only


class Seen(msgspec.Struct, frozen=True):
    """The store as a spare has read it. `followed`: the proof has walked to its head."""

    schema_version: int
    epoch: int
    seq: int
    followed: bool

    @property
    def migrates(self) -> bool:
        """Whether taking it over would bring it up to a newer schema."""
        return self.schema_version < schema.SCHEMA_VERSION


class Spare:
    """One spare, from its first look at the store to its promotion. All methods on the loop's thread.

    `readers`, `engine`, `app` and `ahead` are for the core that it becomes.
    """

    def __init__(
        self,
        data: Path,
        settings: Settings,
        recorder: FlightRecorder,
        rulings: Rulings | None = None,
        ground: Ground | None = None,
    ) -> None:
        """Prepare; nothing is opened yet. `rulings`: absent, there are none. `ground`: from where the book is read."""
        self._data = data
        self._settings = settings
        self._recorder = recorder
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="spare", initializer=be_nice)
        self._order: asyncio.Future[PromoteOrder] = asyncio.get_running_loop().create_future()
        self._told = False
        self._seen: Seen | None = None
        self._aside = False
        self._at_work_on = "looking at the store"
        self.ahead = Ahead(settings.tail_events, (rulings or Rulings()).rebuilding, ground)
        self.app: Starlette = lay_out()
        self.engine: Writing = writing(settings.ledger(data))
        # One more connection than reading threads: the proof of the whole book has its own.
        self.readers: Engine = open_reading(
            settings.ledger(data), settings.readers + 1, settings.write_busy_ms
        )

    @property
    def seq(self) -> int:
        """The last event of the store, as it was seen last."""
        return self._seen.seq if self._seen is not None else 0

    @property
    def at_work_on(self) -> str:
        """What it was doing last, for whoever asks why it stopped there."""
        return self._at_work_on

    @property
    def is_told(self) -> bool:
        """Whether it was told to take over."""
        return self._told

    def promote(self, order: PromoteOrder) -> Callable[[], object] | str:
        """Return what has it take over once it is called, or why it can't be promoted."""
        if self._seen is None:
            return "The spare has not loaded everything yet."
        if self._told:
            return "The spare was told to take over before."
        self._told = True
        return partial(self._order.set_result, order)

    async def warm_up(self) -> Seen | Departure:
        """Read the store, open every connection and rehearse; return what can be told of it, or why it is no use."""
        loop = asyncio.get_running_loop()
        seen = await self._look()
        while not isinstance(seen, Seen):  # for as long as its guard has patience
            self._recorder.event("SPARE_LOOK", seen.text)
            await asyncio.sleep(LOOK_EVERY_S)
            seen = await self._look()
        if not schema.SCHEMA_VERSION_OLDEST <= seen.schema_version <= schema.SCHEMA_VERSION:
            return departure.config_invalid(
                f"{LEDGER_FILE} has schema {seen.schema_version}, made by another version of this program:"
                " use that version."
            )
        if (unsound := self._unsound()) is not None:
            return unsound
        await asyncio.to_thread(self._open_readers)
        self._at_work_on = "rehearsing to write"
        await loop.run_in_executor(self._thread, rehearse_writing, self.engine)
        if not seen.migrates:
            await self._rehearse(seen)
        self._at_work_on = "waiting"
        self._seen = seen
        return seen

    async def told(self) -> PromoteOrder | Departure:
        """Follow the book until the order comes, or it is seen broken; by then nothing of this is at work any more.

        A look that fails is tried again: what the store is worth is said at the promotion.
        """
        rest_s = SLICE_REST_S
        while not (await asyncio.wait({self._order}, timeout=rest_s))[0]:
            if self._steps_aside(await self._log_bytes()):
                rest_s = LOOK_EVERY_S
                continue
            found = await self._look()
            if isinstance(found, Seen):
                self._seen = found
                rest_s = LOOK_EVERY_S if found.followed else SLICE_REST_S
            else:
                self._recorder.event("SPARE_LOOK", found.text)
                rest_s = LOOK_EVERY_S
            if (unsound := self._unsound()) is not None:
                self._thread.shutdown(wait=False)
                return unsound
        self._thread.shutdown(wait=False)
        return self._order.result()

    def close(self) -> None:
        """Let go of the store, of a spare that was never promoted."""
        self._thread.shutdown()
        self.readers.dispose()

    def _unsound(self) -> Departure | None:
        """Return that the book is broken, if it was seen so: no core may come of whoever has seen that."""
        fault = self.ahead.fault
        return None if fault is None else departure.corrupt(fault.sentence)

    def _steps_aside(self, log_bytes: int) -> bool:
        """Whether nothing is to be looked at now, so that the log of the book can be emptied by who writes it."""
        aside = log_bytes > LOG_BYTES_MAX
        if aside is not self._aside:
            self._aside = aside
            self._recorder.event(
                "SPARE_ASIDE" if aside else "SPARE_FOLLOWS", f"the log has {log_bytes} bytes"
            )
        return aside

    async def _log_bytes(self) -> int:
        """Return how long the log is, seen from outside: no file of the book is opened for it."""

        def look() -> int:
            try:
                return self._data.joinpath(f"{LEDGER_FILE}-wal").stat().st_size
            except OSError:
                return 0

        return await asyncio.get_running_loop().run_in_executor(self._thread, look)

    async def _look(self) -> Seen | StoreError:
        return await asyncio.get_running_loop().run_in_executor(self._thread, self._read)

    def _read(self) -> Seen | StoreError:
        try:
            with snapshot(self.readers, self._settings.read_ms_max) as connection:
                row = queries.head(connection)
                followed = row.schema_version != schema.SCHEMA_VERSION or self.ahead.follow(connection)
        except DBAPIError as error:
            return store_error(error)
        return Seen(row.schema_version, row.epoch, row.head_seq, followed)

    def _open_readers(self) -> None:
        """Open every connection there will be, and leave each of them without a transaction."""
        with ExitStack() as together:
            for _ in range(self._settings.readers + 1):
                together.enter_context(snapshot(self.readers, self._settings.read_ms_max))

    async def _rehearse(self, seen: Seen) -> None:
        recorder = NoRecorder()
        service = Service(Unwritten(seen.seq), self.readers, recorder, self._settings, seen.epoch, REHEARSING)
        app = make_app(service, Desk(service, recorder, self._data), self.app)

        async def noted(scope: Scope, receive: Receive, send: Send) -> None:
            self._at_work_on = f"drawing {scope['path']} for nobody"
            await app(scope, receive, send)

        try:
            await rehearse(noted)
        finally:
            service.drain()
            await service.end_threads()
            recorder.close()
