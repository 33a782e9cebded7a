"""A core from its first to its last moment.

The order is the design: instruments first, so that any death from here on leaves evidence; the socket bound
before the store is touched, so that a taken port costs no epoch; the guard's rules before the book; the fence before the
proof; READY only when a request could be answered. Leaving has two ways. Asked to, a core finishes what it has; after a
failed commit, a higher epoch or a mistake of ours it touches the store no more and is gone by `os._exit`, because closing a
database is a write, and a process whose loop is over while its writer lives is half dead.
"""

import asyncio
import functools
import importlib
import logging
import os
import signal
import socket
from collections.abc import Callable, Coroutine, Iterable
from pathlib import Path
from typing import Any, Final, NoReturn

from sqlalchemy import Engine

from core import departure
from core.audit import audit_behind
from core.auditor import AUDITOR
from core.build import own_build
from core.checkpointing import CHECKPOINT_S, CHECKPOINTER, Checkpointer
from core.collecting import collect_from_now_on
from core.departure import Departure, ExitCode
from core.draining import Drain
from core.errands import SOURCES
from core.exporter import EXPORTER
from core.guarded import oom
from core.guarded.control import VERSION as CONTROL_VERSION
from core.guarded.control import ControlUnboundError
from core.guarded.environment import GuardedEnvironment, LastSeen
from core.guarded.life import Instruments, guarded_life
from core.guarded.recorder import LifeState
from core.imports.desk import Desk
from core.imports.importer import COMPONENT as IMPORTER
from core.imports.suspected import Suspected
from core.journal import ballast
from core.journal.checkpoints import Checkpoints
from core.journal.ground import Ground
from core.journal.proof import Witness
from core.journal.store import Server, StoreError, open_reading
from core.journal.writer import Writer
from core.keeping.daily import DailyBackup
from core.listening import PAGE_SOCKET, LedgerServer, bind_loopback, bind_unix
from core.notifier import NOTIFIER, Notifier
from core.obedience import Obedience
from core.opening import OpenBook, Telling, Terms, open_book
from core.opening_to_read import ReadableBook, open_to_read
from core.recurring import recurring_source
from core.rulings import Rulings
from core.safety import Safety
from core.saying import say
from core.scheduler import SCHEDULER, Scheduler
from core.service import Service, Unwritten
from core.settings import Settings
from core.warming import Spare
from core.web.app import make_app

REST_AFTER_READY_S: Final = 0.2
LAST_FLUSH_S: Final = 0.02  # one turn of the loop writes the last answers out; this is a few

Book = OpenBook | ReadableBook

logger = logging.getLogger("core")


class Life:
    """One life of a core. `run` is called once."""

    def __init__(
        self,
        data: Path,
        port: int,
        environment: GuardedEnvironment,
        settings: Settings,
        instruments: Instruments,
    ) -> None:
        """Prepare; nothing is touched yet. `port` counts only where the environment names no socket."""
        self._data = data
        self._port = port
        self._environment = environment
        self._settings = settings
        self._recorder = instruments.recorder
        self._beacon = instruments.beacon
        self._ended: asyncio.Future[Departure | None] | None = None
        self._rulings = Rulings.beside(environment.quarantine)
        self._obedience = Obedience(self._rulings, environment.memory_bytes)
        self._checkpoints = Checkpoints.of(
            data, self._note_checkpoint, environment.checkpoints_kept, environment.checkpoint_age_h
        )
        self._ground = Ground(self._checkpoints, whole=not environment.recovers_state)
        self._safety: Safety | None = None
        self._trying: asyncio.Task[NoReturn] | None = None
        self._scheduling: Scheduler | None = None
        self._spare: Spare | None = None
        self._service: Service | None = None
        self._writer: Writer | None = None
        self._drain: Drain | None = None
        self._holds_guard = True
        self._behind: list[asyncio.Task[object]] = []
        self._taking_up: asyncio.Task[None] | None = None

    async def run(self) -> Departure | None:
        """Live; return None if the end was asked for, else why there was no life."""
        loop = asyncio.get_running_loop()
        self._ended = loop.create_future()
        if not self._environment.guarded:
            loop.add_signal_handler(signal.SIGINT, self._end, None)
        try:
            async with guarded_life(
                self._environment,
                self._recorder,
                self._beacon,
                guarded=self._obedience,
                on_term=lambda _: self._end(None),
                on_beat=self._beat,
                census_ms=self._settings.census_ms,
            ):
                return await self._live(loop)
        except ControlUnboundError as error:
            sentence = (
                f"The control socket can't be bound ({error.strerror}): name another in HARDCORE_CONTROL."
            )
            return departure.config_invalid(sentence)

    async def _live(self, loop: asyncio.AbstractEventLoop) -> Departure | None:
        bound = self._bind()
        if isinstance(bound, str):
            return departure.config_invalid(bound)
        terms = self._terms()
        if self._environment.spare:
            promoted = await self._wait(loop)
            if not isinstance(promoted, Terms):
                bound.close()
                return promoted
            terms = promoted
        await self._read_rulings()
        book = await loop.run_in_executor(None, self._opening(terms))
        if isinstance(book, Departure):
            bound.close()
            return book
        service = self._read_book(book) if isinstance(book, ReadableBook) else self._serve_book(book, loop)
        self._service = service
        try:
            return await self._serve(loop, bound, book, service)
        # The writer's thread outlives the loop: an exception that only ended the loop would leave a process
        # that holds the store, answers nobody and hears no TERM.
        except Exception as error:
            logger.exception("The core stops at a mistake of our own")
            self._vanish(departure.bug(repr(error)))

    async def _read_rulings(self) -> None:
        """Know what the guard has said by now, before anything of the book is touched."""
        fault = await asyncio.to_thread(self._rulings.read)
        if fault is not None:
            self._recorder.event("RULES_UNREAD", fault.why)
            logger.error("The guard's rules can't be read, and those before stay in force. %s", fault.why)

    def _terms(self) -> Terms:
        told = self._environment
        return Terms(told.expected_epoch, _as_witnesses(told.witnesses), None, told.guarded)

    def _opening(self, terms: Terms) -> Callable[[], Book | Departure]:
        if self._environment.safe is not None:
            return functools.partial(open_to_read, self._data, self._environment, self._settings)
        telling = Telling(self._recorder, self._beacon)
        opening = functools.partial(open_book, self._data, terms, self._settings, telling)
        spare = self._spare
        ahead, engine = (None, None) if spare is None else (spare.ahead, spare.engine)
        return functools.partial(opening, ahead, engine, self._rulings, self._ground)

    async def _wait(self, loop: asyncio.AbstractEventLoop) -> Terms | Departure | None:
        """Load and read everything and wait for the order; None if the end was asked for before it came."""
        self._recorder.set_state(LifeState.SPARE)
        self._obedience.build = own_build()
        await self._read_rulings()  # it reads the book ahead of its promotion
        spare = self._spare = Spare(self._data, self._settings, self._recorder, self._rulings, self._ground)
        self._obedience.wait(spare)
        waiting = loop.create_task(self._until_told(spare))
        assert self._ended is not None
        either: set[asyncio.Future[Any]] = {waiting, self._ended}
        await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
        if waiting.done():
            error = waiting.exception()
            if error is None:
                return waiting.result()
            # Whatever it was: the guard goes by the exit code, and a bare traceback has one that means nothing.
            logger.error("The spare stops at a mistake of our own", exc_info=error)
            return departure.bug(f"{spare.at_work_on}: {error!r}")
        waiting.cancel()
        await asyncio.wait({waiting})
        await loop.run_in_executor(None, spare.close)
        return None

    async def _until_told(self, spare: Spare) -> Terms | Departure:
        seen = await spare.warm_up()
        if isinstance(seen, Departure):
            return self._of_no_use(seen)
        # What was loaded lives as long as the process: no collection need ever look at it.
        collect_from_now_on()
        self._beacon.spare(
            self._obedience.build, CONTROL_VERSION, seen.schema_version, migrates=seen.migrates
        )
        logger.info("A spare for the ledger of %s waits, at event %d.", self._data, seen.seq)
        order = await spare.told()
        if isinstance(order, Departure):
            return self._of_no_use(order)
        self._recorder.set_state(LifeState.STARTING)
        oom.rank(oom.CORE)
        return Terms(order.expected_epoch, _as_witnesses(order.witnesses), order.busy_ms, shared=True)

    def _of_no_use(self, left: Departure) -> Departure:
        if left.code is ExitCode.STORE_CORRUPT:
            # The core that serves began at an attestation, and may never come across it.
            self._beacon.unsound(left.sentence)
        return left

    async def _serve(
        self, loop: asyncio.AbstractEventLoop, bound: socket.socket, book: Book, service: Service
    ) -> Departure | None:
        desk = Desk(service, self._recorder, self._data, Suspected(self._rulings, self._beacon.cases))
        drain = self._drain = Drain(
            service, desk, self._writer, self._recorder, functools.partial(self._lay_down, book), self._stuck
        )
        self._obedience.drain_with(drain)
        server = LedgerServer(make_app(service, desk, self._spare.app if self._spare is not None else None))
        await server.start(bound)
        if self._environment.control is not None:
            self._rulings.word.expect(self._settings.guards_word_ms)
        self._ready(book, bound)
        self._obedience.parts.add(AUDITOR, service.auditor)
        self._obedience.parts.add(EXPORTER, service.exporter)
        if isinstance(book, OpenBook):
            self._obedience.parts.add(IMPORTER, desk.importer)
            self._obedience.parts.add(SCHEDULER, self._scheduler(service))
            self._taking_up = loop.create_task(desk.start())  # never called off: the desk's end waits for it
        self._begin_behind(loop, service, book)
        assert self._ended is not None
        left = await self._ended
        self._end_behind()
        if left is not None:
            await self._leave_at_once(left, service)
        await self._leave(service, server, book, desk)
        return None

    def _begin_behind(self, loop: asyncio.AbstractEventLoop, service: Service, book: Book) -> None:
        """Begin what nobody waits for: to name the code, to prove the whole ledger, to lay the ballast."""
        works: list[Coroutine[Any, Any, object]] = [audit_behind(service, self._beacon)]
        if not self._obedience.build:
            works.append(self._load_the_rest())
        if isinstance(book, OpenBook):
            rests = self._settings.verify_after_ms, self._settings.ballast_ms
            if not isinstance(self._settings.ledger(self._data), Server):
                works.append(ballast.keep_laid(self._data, *rests))
            works += self._checkpointing(service)
            assert self._scheduling is not None, "who serves a book to write on has one"
            works.append(self._scheduling.run())
        self._behind = [loop.create_task(work) for work in works]
        for task in self._behind:
            task.add_done_callback(_say_failure)

    def _scheduler(self, service: Service) -> Scheduler:
        failed = functools.partial(self._recorder.event, "BACKUP_FAILED")
        scheduler = self._scheduling = Scheduler(
            service,
            service.readers,
            self._recorder,
            self._settings,
            self._rulings,
            (*SOURCES, recurring_source(self._rulings)),
            (DailyBackup(self._data, self._settings, failed),),
            self._beacon.cases,
        )
        return scheduler

    def _checkpointing(self, service: Service) -> list[Coroutine[Any, Any, object]]:
        checkpointer = Checkpointer(
            self._checkpoints,
            service.readers,
            self._recorder,
            self._settings,
            self._rulings.rebuilding,
            lambda: service.head_seq,
            self._beacon.unsound,
            service.leaving,
        )
        self._obedience.checkpointer = checkpointer
        self._obedience.parts.add(CHECKPOINTER, checkpointer)
        self._obedience.gone_by = service.gone_by = self._ground.gone_by
        told_s = self._environment.checkpoint_s
        every_s = CHECKPOINT_S if told_s is None else told_s
        return [checkpointer.keep_making(every_s)] if every_s else []

    def _note_checkpoint(self, name: str, what: str) -> None:
        self._recorder.event("CHECKPOINT", f"{name} {what}")
        logger.info("Checkpoint %s: %s.", name, what)

    def _end_behind(self) -> None:
        for task in self._behind:
            task.cancel()

    async def _load_the_rest(self) -> None:
        # Twenty milliseconds of work, for which the answers that somebody has waited for should not have to wait.
        await asyncio.sleep(REST_AFTER_READY_S)
        await asyncio.to_thread(importlib.import_module, PAGE_SOCKET)
        self._obedience.build = await asyncio.to_thread(own_build)

    def _bind(self) -> socket.socket | str:
        try:
            self._data.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            return (
                f"The data folder {self._data} can't be made ({error.strerror}): choose another with --data."
            )
        if self._environment.socket is not None:
            return bind_unix(self._environment.socket)
        return bind_loopback(self._port)

    def _serve_book(self, book: OpenBook, loop: asyncio.AbstractEventLoop) -> Service:
        writer = self._writer = Writer(
            book.journal,
            self._recorder,
            loop,
            on_shut=self._shut,
            on_failed=lambda text: self._end(departure.commit_failed(text)),
            on_fenced=functools.partial(self._fenced, book.epoch),
            on_bug=lambda error: self._vanish(departure.bug(repr(error))),
        )
        writer.start()
        fenced = functools.partial(self._fenced, book.epoch)
        service = Service(
            writer,
            self._readers(),
            self._recorder,
            self._settings,
            book.epoch,
            on_fenced=fenced,
            rulings=self._rulings,
        )
        notifier = Notifier(service.hub, self._recorder)
        notifier.start()
        writer.listen(notifier.committed)
        self._obedience.parts.add(NOTIFIER, notifier)
        self._safety = Safety(service, writer, self._recorder, self._beacon)
        self._obedience.serve(service, self._safety, writer)
        if not self._environment.guarded:
            self._trying = loop.create_task(self._safety.keep_trying(self._settings.safe_again_ms))
        return service

    def _readers(self) -> Engine:
        if self._spare is not None:
            return self._spare.readers
        # One more connection than reading threads: the proof of the whole book has its own.
        return open_reading(
            self._settings.ledger(self._data), self._settings.readers + 1, self._settings.write_busy_ms
        )

    def _read_book(self, book: ReadableBook) -> Service:
        safe = self._environment.safe
        self._recorder.set_epoch(book.epoch)
        service = Service(
            Unwritten(book.head_seq),
            book.readers,
            self._recorder,
            self._settings,
            book.epoch,
            safe,
            rulings=self._rulings,
        )
        self._safety = Safety(service, None, self._recorder, self._beacon)
        self._obedience.serve(service, self._safety, None)
        return service

    def _beat(self, now_ns: int) -> None:
        if self._service is not None:
            self._service.beat(now_ns)

    def _fenced(self, mine: int, actual: int) -> NoReturn:
        self._vanish(departure.fenced(mine, actual))

    def _stuck(self) -> NoReturn:
        self._vanish(departure.bug("the store could neither be closed nor used again"))

    def _lay_down(self, book: Book) -> None:
        """Leave the book to a successor, for good."""
        self._end_behind()
        self._let_go(book)

    def _let_go(self, book: Book) -> None:
        if self._holds_guard:
            self._holds_guard = False
            book.guard.release()

    def _shut(self, error: StoreError) -> None:
        assert self._safety is not None, "it is there before the writer has anything to write"
        self._safety.shut(error)

    def _ready(self, book: Book, bound: socket.socket) -> None:
        # What was loaded lives as long as the process: no collection need ever look at it.
        collect_from_now_on()
        self._recorder.set_state(LifeState.READY)
        self._recorder.event("READY", f"epoch {book.epoch}")  # a later guard sees whether it has lasted
        if isinstance(book, ReadableBook):
            self._beacon.ready(book.epoch, book.head_seq, book.head_hash.hex(), "none", 0)
        else:
            proof = book.proof
            self._beacon.ready(
                book.epoch, proof.head_seq, proof.head_hash.hex(), proof.kind.value, proof.tail
            )
        where = bound.getsockname()
        place = where if isinstance(where, str) else f"http://{where[0]}:{where[1]}"
        only = f", reads only ({self._environment.safe})" if isinstance(book, ReadableBook) else ""
        logger.info("Serving the ledger of %s on %s, epoch %d%s.", self._data, place, book.epoch, only)

    async def _leave(self, service: Service, server: LedgerServer, book: Book, desk: Desk) -> None:
        leaving_s = (self._settings.drain_ms + self._settings.close_ms) / 1000
        gone_s = asyncio.get_running_loop().time() + leaving_s
        assert self._drain is not None, "who serves can be drained"
        self._drain.leave()
        self._recorder.set_state(LifeState.DRAINING)
        self._beacon.stopping()
        service.drain()
        answered = await service.all_answered(self._settings.drain_ms)
        self._recorder.set_state(LifeState.STOPPING)
        if not answered:
            self._recorder.event("DRAIN_INCOMPLETE", f"{service.in_flight} requests are not answered")
        try:
            # What is stuck may be stuck for ever, in the store or in a thread that can't be joined, also where
            # every request is answered: a proof of the whole book takes no slot. What has not been committed is
            # not done; the store is as whole as after any death. Time that was not drained is left to the closing.
            async with asyncio.timeout_at(gone_s):
                await self._close(service, server, book, desk)
        except TimeoutError:
            self._recorder.event("CLOSE_INCOMPLETE", "left with work that does not end")
            os._exit(ExitCode.ASKED)

    async def _close(self, service: Service, server: LedgerServer, book: Book, desk: Desk) -> None:
        if self._trying is not None:
            self._trying.cancel()
        if isinstance(book, OpenBook):
            await desk.stop()
        await server.stop()
        if self._obedience.checkpointer is not None:
            await self._obedience.checkpointer.end()
        await service.close()
        self._let_go(book)

    async def _leave_at_once(self, left: Departure, service: Service) -> NoReturn:
        assert self._drain is not None, "who serves can be drained"
        self._drain.leave()
        service.drain()
        await service.all_answered(self._settings.last_answers_ms)
        await asyncio.sleep(LAST_FLUSH_S)
        self._vanish(left)

    def _vanish(self, left: Departure) -> NoReturn:
        """End the process without touching the store again: closing it would write to it."""
        self._recorder.last_words(left.word, left.sentence)
        os._exit(said(left))

    def _end(self, left: Departure | None) -> None:
        self._obedience.leave()
        if self._ended is not None and not self._ended.done():
            self._ended.set_result(left)


def said(left: Departure) -> int:
    """Say why this process leaves, and return the code it leaves with."""
    say(left.sentence)
    return left.code.value


def _say_failure(task: "asyncio.Task[object]") -> None:
    """Say in the log why work that nobody waits for has failed: without it everything is served all the same."""
    if not task.cancelled() and task.exception() is not None:
        logger.error("Work behind the serving has failed.", exc_info=task.exception())


def _as_witnesses(seen: Iterable[LastSeen]) -> tuple[Witness, ...]:
    return tuple(Witness(one.seq, one.epoch, one.hash) for one in seen)
