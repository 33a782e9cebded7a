"""The scheduler: the component that does what falls due, when nobody asks for it.

What is due is found in the book and never remembered beside it: each source is a question that names the errands of this
moment, and each errand is a command under a key that says what it is. So a death, a second core or a clock that was put back
can't do one twice, and what fell due while everything was off is done at the next round. An errand goes the way of everybody's
commands, with a slot, under the guard's rules; one of which a core has died waits for its trial, and the others go on. Only a
core that writes runs errands. Not chosen: a timer for each item; a thousand timers are a second list of what the book knows,
and would have to be kept in step with it.
"""

import asyncio
import base64
import datetime as dt
import logging
from collections.abc import Awaitable, Callable, Iterator, Sequence
from typing import Final

import msgspec
from sqlalchemy import Connection, Engine
from sqlalchemy.exc import DBAPIError

from core.alone import Turns
from core.cases import Case, file_cases
from core.guarded.poison import name_of
from core.guarded.recorder import FlightRecorder
from core.journal.answers import Answer, Done, KeyTaken, Refused, SetAside, status_of
from core.journal.store import beside, snapshot
from core.ledger.commands import Command, accounts_of, transaction_of
from core.ledger.reasons import Slug
from core.rulings import WORD_EVERY_S, Rulings
from core.service import Service
from core.settings import Settings
from core.slots import Draining, NoSlot, holding_slot

SCHEDULER: Final = "scheduler"  # its name on the recorder page
SILENT_MS_MAX: Final = 15_000  # for a question, or an answer of the writer
ERRANDS_MAX: Final = 500  # of one round; the rest is due at the next, which begins at once
ANSWERED_MAX: Final = 10_000
SOURCE: Final = "scheduler"

logger = logging.getLogger("core.scheduler")


class Errand(msgspec.Struct, frozen=True):
    """A command that is due, and its key. `path` and `body`: the request that would do the same, for a trial."""

    key: str
    kind: str
    command: Command
    path: str
    body: bytes = b""


#: Names what is due in a book at a moment of wall time (UTC), at most so many.
Source = Callable[[Connection, dt.datetime, int], Sequence[Errand]]
#: Does what is no command and falls due by the clock, such as a backup; at once where there is nothing to do.
Deed = Callable[[dt.datetime], Awaitable[None]]


def _now() -> dt.datetime:
    return dt.datetime.now(dt.UTC)


class Scheduler:
    """The component. All methods on the loop's thread."""

    def __init__(
        self,
        service: Service,
        readers: Engine,
        recorder: FlightRecorder,
        settings: Settings,
        rulings: Rulings,
        sources: Sequence[Source],
        deeds: Sequence[Deed] = (),
        tell: Callable[[Sequence[str]], object] = lambda _names: None,
        clock: Callable[[], dt.datetime] = _now,
    ) -> None:
        """Prepare; nothing is done before `run`. `tell` is told the names of the cases that were filed."""
        self._service = service
        self._readers = beside(readers)
        self._settings = settings
        self._rulings = rulings
        self._sources = sources
        self._deeds = deeds
        self._tell = tell
        self._clock = clock
        self._beats = recorder.component(SCHEDULER, SILENT_MS_MAX)
        self._turns = Turns(SCHEDULER, self._beats)
        self._answered: dict[str, None] = {}  # keys with a no: asked again they would hear the same
        self._shift = 0
        self._work: set[asyncio.Task[None]] = set()

    async def run(self) -> None:
        """Do what falls due until this is called off."""
        deeds = [asyncio.create_task(self._keep_doing(deed), name=SCHEDULER) for deed in self._deeds]
        try:
            self._go_on()
            await asyncio.Event().wait()
        finally:
            self._shift += 1  # a command at the writer is answered, and nothing follows it
            for task in deeds:
                task.cancel()

    def begin_anew(self) -> None:
        """Leave a round that hangs behind and begin another; what it had at the writer comes true once, by its key."""
        self._turns.begin_anew()
        self._go_on()

    def stall(self) -> None:
        """Have the next question come to no end, and ask it now: a drill."""
        self._turns.stall()
        if not self._turns.is_busy:
            self._go_on()

    def _go_on(self) -> None:
        """Begin rounds anew. Those before end by themselves: a command of theirs may still be at the writer."""
        self._shift += 1
        task = asyncio.create_task(self._rounds(self._shift), name=SCHEDULER)
        self._work.add(task)
        task.add_done_callback(self._work.discard)

    async def _rounds(self, shift: int) -> None:
        while shift == self._shift and not self._rulings.word.is_said:  # noqa: ASYNC110  # time ends it as well
            await asyncio.sleep(WORD_EVERY_S)
        while shift == self._shift:
            more = False
            try:
                if self._may_write():
                    more = await self._round(shift)
            # A mistake in one round must not end all that would follow; what is due stays due.
            except Exception:
                logger.exception("A round of the scheduler has failed")
            if not more:
                await asyncio.sleep(self._settings.schedule_every_ms / 1000)

    async def _round(self, shift: int) -> bool:
        """Do what is due now; return whether there is more of it."""
        due = await self._turns.do(lambda go_on: self._due(self._clock(), go_on))
        fresh = [one for one in due if one.key not in self._answered]
        suspects = [one for one in fresh if name_of(one.key) in self._rulings.quarantine.rules.suspects]
        if suspects:
            await asyncio.to_thread(self._file, suspects)
        done = 0
        self._beats.works(True)
        try:
            for one in fresh:
                if shift != self._shift or not self._may_write():
                    return False
                if one not in suspects and await self._carry_out(one):
                    done += 1
                self._beats.done()
        finally:
            self._beats.works(False)
        return done > 0 and len(due) >= ERRANDS_MAX

    def _due(self, now: dt.datetime, go_on: Callable[[], None]) -> list[Errand]:
        found: list[Errand] = []
        try:
            for source in self._sources:
                go_on()
                with snapshot(self._readers, self._settings.read_ms_max) as connection:
                    found += source(connection, now, ERRANDS_MAX - len(found))
        except DBAPIError as error:
            logger.warning("What is due can't be read now: %s", error.orig)
        return found

    async def _carry_out(self, errand: Errand) -> bool:
        """Ask the ledger once; return whether it is done. What could not be asked now is due again."""
        command_id = self._service.new_id()
        with holding_slot(
            self._service,
            errand.kind,
            errand.body,
            key=errand.key,
            command_id=command_id,
            transaction_id=transaction_of(errand.command),
            account_ids=accounts_of(errand.command),
        ) as held:
            if isinstance(held, Draining | NoSlot):
                return False
            answer = await self._service.carry_out(
                errand.command,
                errand.key,
                errand.key.encode(),
                command_id,
                held.slot,
                kind=errand.kind,
                body_bytes=len(errand.body),
            )
            held.status = _status(answer)
        if isinstance(answer, Done):
            return True
        self._note_no(errand, answer)
        return False

    def _note_no(self, errand: Errand, answer: Answer) -> None:
        if not isinstance(answer, Refused | KeyTaken | SetAside):
            return
        if isinstance(answer, Refused) and answer.rejection.slug is Slug.NOT_YET_EXPIRED:
            return  # the clock was put back in between: it is due again when its time has come
        logger.info("Not done, and not tried again by this core: %s (%s)", errand.key, type(answer).__name__)
        self._answered[errand.key] = None
        for oldest in _first(self._answered, len(self._answered) - ANSWERED_MAX):
            del self._answered[oldest]

    def _file(self, suspects: Sequence[Errand]) -> None:
        if self._rulings.cases is None:
            return
        cases = [_case_of(one) for one in suspects]
        try:
            file_cases(self._rulings.cases, cases)
        except OSError as error:
            logger.warning("The cases of %d errands can't be filed: %s", len(cases), error.strerror)
            return
        self._tell([one.name for one in cases])

    async def _keep_doing(self, deed: Deed) -> None:
        while True:
            try:
                if self._may_write():
                    await deed(self._clock())
            # As in a round: the next turn may succeed.
            except Exception:
                logger.exception("A deed of the scheduler has failed")
            await asyncio.sleep(self._settings.schedule_every_ms / 1000)

    def _may_write(self) -> bool:
        return self._service.safe is None and not self._service.draining and not self._service.is_laid_down


def _status(answer: Answer) -> int:
    """Return the status that the recorder is told; 0: nothing was answered for good."""
    match answer:
        case Done(status=status):
            return status
        case Refused(rejection=rejection):
            return status_of(rejection.slug)
        case _:
            return 0


def _first(keys: dict[str, None], count: int) -> Iterator[str]:
    return iter(list(keys)[: max(0, count)])


def _case_of(errand: Errand) -> Case:
    headers = [["Idempotency-Key", errand.key], ["Content-Type", "application/json"]]
    body = base64.b64encode(errand.body).decode()
    request = {"method": "POST", "path": errand.path, "headers": headers, "body": body}
    return Case(name_of(errand.key), errand.key, SOURCE, {"request": request})
