"""The importer: a component of its own that books the rows of committed imports, and goes on after a death.

It is one task with its own beat on the recorder page, beside the requests and not among them: rows enter the
ledger by the same door as everybody's commands, each with a slot, a key and the writer's line, and only a few
at a time, so a person's request never waits behind a file. A row's key is the import's id and its place in the
file; where a death leaves it unclear whether a row was booked, it is simply asked again. So the progress on the
disk may lag, and no second bookkeeping of rows is needed. Several imports take turns, wave by wave.
It can be begun anew beside one that hangs: each shift has jobs of its own, and one whose shift is over does nothing
any more, whatever it wakes up from. What it had at the writer comes true once, because a row's key is the same in
every shift. Not chosen: to cancel what hangs; a thread can't be, and a row's slot would be given away under the writer.
"""

import asyncio
import logging
import time
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice
from typing import Final, TypeVar, assert_never

import msgspec

from core import frames
from core.alone import alone
from core.guarded.naming import ids_shown
from core.guarded.poison import name_of
from core.guarded.recorder import FlightRecorder
from core.hub import Frame
from core.imports import judging
from core.imports.folder import ImportFolder
from core.imports.outcomes import FAILED_INSIDE, Outcome, Stopped, meaning_of, refused, settle
from core.imports.reading.candidates import Candidate, Result, SkippedRow
from core.imports.records import Manifest, Progress
from core.imports.states import State, Trigger, Waiting, after
from core.imports.suspected import HeldRow, Suspected
from core.ledger.commands import accounts_of
from core.ledger.entries import RecordEntry
from core.ledger.reasons import Rejection
from core.service import Service
from core.slots import Draining, NoSlot, holding_slot

T = TypeVar("T")

IN_FLIGHT_MAX: Final = 16  # of 256 slots: the rest is everybody else's
READ_AHEAD_ROWS: Final = 256
TELL_EVERY_NS: Final = 250_000_000
AGAIN_AFTER_S: Final = 0.1
END_AGAIN_AFTER_NS: Final = 1_000_000_000  # where the end of an import, or a case, could not be written
SAY_AGAIN_NS: Final = 5_000_000_000  # a court that says nothing may be another one by now
BEAT_S: Final = 0.25  # while a wave is at the writer, which may wait a second for somebody's lock

COMPONENT: Final = "importer"  # its name on the recorder page
SILENT_MS_MAX: Final = 10_000  # between two beats of work: keeping how far it is takes a slow disk some time
_STALL_S: Final = 86_400.0  # of a drill: longer than anybody's patience
KIND: Final = "import.row"
KEPT_FILE_LOST: Final = "kept-file-lost"

logger = logging.getLogger("core.imports")


def _no_rows() -> Iterator[Result]:
    return iter(())


class Job(msgspec.Struct):
    """One committed import. `rows` are all of its rows, parsed as they are needed; `parsed` of them are.

    Those before `progress.done` are settled and only parsed: which of several identical rows one is depends on
    the rows before it. `end` is the state it has come to, while that is not on the disk yet. `waits_for`: the name
    of its next row, while that one waits for its trial; `filed`: whose cases are; `file_again_ns`: when they are filed,
    or said, once more. `waiting`: why it does not go on, as its pages were told last. `rows_anew` gives all rows once
    more. `shift`: whose work it is.
    """

    folder: ImportFolder
    manifest: Manifest
    total: int
    rows: Iterator[Result]
    progress: Progress
    parsed: int = 0
    ahead: deque[Result] = msgspec.field(default_factory=deque)
    told_ns: int = 0
    end: State | None = None
    end_again_ns: int = 0
    waits_for: str = ""
    filed: set[str] = set()
    file_again_ns: int = 0
    waiting: Waiting | None = None
    rows_anew: Callable[[], Iterator[Result]] = _no_rows
    shift: int = 0


class RowsLostError(Exception):
    """The kept rows end early or are torn."""


class Importer:
    """The component. All methods on the loop's thread."""

    def __init__(
        self, service: Service, recorder: FlightRecorder, suspected: Suspected | None = None
    ) -> None:
        """Prepare. How far each import is, is told to the hub now and then and at every end.

        `suspected`: rows that wait for their trial; absent: none does.
        """
        self._service = service
        self._suspected = suspected or Suspected()
        self._component = recorder.component(COMPONENT, SILENT_MS_MAX)
        self._jobs: deque[Job] = deque()
        self._wake = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._left: set[asyncio.Task[None]] = set()  # of shifts that were left behind
        self._shift = 0
        self._stalls = False
        self._resting = False

    def start(self) -> None:
        """Work from now on; also again after `stop`, which may not have come to its end yet."""
        self._resting = False
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._run(self._shift), name=COMPONENT)

    def begin_anew(self) -> None:
        """Leave the shift that hangs behind, and go on with all imports where it was."""
        self._shift += 1
        self._stalls = False
        self._jobs = deque(_anew(job, self._shift) for job in self._jobs)
        self._component.works(False)  # who hangs says so no more
        if self._task is not None:
            self._left.add(self._task)
            self._task.add_done_callback(self._left.discard)
        self._task = asyncio.create_task(self._run(self._shift), name=COMPONENT)

    def stall(self) -> None:
        """Hang in the next read of rows, or in one for nobody: a drill."""
        self._stalls = True
        self._wake.set()

    def add(self, job: Job) -> None:
        """Take an import on."""
        job.shift = self._shift
        self._jobs.append(job)
        self._wake.set()

    def job(self, import_id: str) -> Job | None:
        """Return an import that is being booked."""
        return next((job for job in self._jobs if job.manifest.id == import_id), None)

    async def stop(self) -> None:
        """End between two waves. Whoever no longer waits for that may `start` it again."""
        self._resting = True
        self._wake.set()
        if self._task is not None:
            await asyncio.wait(
                {self._task}
            )  # and no more: who is tired of waiting must not end the work itself
            self._task.result()

    def _is_over(self, shift: int) -> bool:
        """Whether whoever is at work in this shift is to do nothing more."""
        return shift != self._shift or self._resting or self._service.draining

    def _is_at_work(self, shift: int) -> bool:
        """Whether what this shift would write is still wanted. Any thread."""
        return shift == self._shift

    async def _run(self, shift: int) -> None:
        # Whoever knew of a death may have said whom he suspects after this core has opened its book.
        self._component.works(True)
        await self._apart(self._suspected.look_again)
        if shift == self._shift:
            self._component.works(False)
        while not self._is_over(shift):
            self._wake.clear()
            if self._jobs or self._stalls:
                self._component.works(True)
                await self._until_idle(shift)
                if shift == self._shift:
                    self._component.works(False)
            else:
                await self._wake.wait()

    async def _apart(self, work: Callable[[], T]) -> T:
        """Do what blocks on a thread that can be left behind. No beat meanwhile: it may be what hangs."""
        return await alone(work, COMPONENT)

    async def _until_idle(self, shift: int) -> None:
        if self._stalls:
            await self._apart(partial(time.sleep, _STALL_S))
        while self._jobs and not self._is_over(shift):
            waits = all(self._waits(job) for job in self._jobs)
            if waits or self._service.safe is not None:
                self._component.beat()
                await asyncio.sleep(
                    AGAIN_AFTER_S
                )  # a disk that has room again tells nobody, nor does a court
                continue
            await self._turn(self._jobs[0])
            if not self._is_over(shift):
                self._jobs.rotate(-1)

    def _waits(self, job: Job) -> bool:
        """Whether there is nothing to be done for an import at this moment; its pages hear when why changes."""
        now_ns = time.monotonic_ns()
        why = self._suspected.halts(job.manifest.id, job.waits_for, time.time_ns())
        why = why if job.end is None else None
        if why is not job.waiting:
            job.waiting = why
            self._service.hub.tell([frame_of(job)])
        match why:
            case Waiting.SOURCE_STOPPED:
                return True
            case Waiting.TRIAL:
                return job.file_again_ns > now_ns
            case None:
                return job.end_again_ns > now_ns
            case _:
                assert_never(why)

    async def _turn(self, job: Job) -> None:
        """Book one wave of one import. A bug of ours that one file brings to light stops that file alone."""
        if self._waits(job):
            return
        if job.end is None:
            try:
                job.end = await self._wave(job)
            except RowsLostError:
                _break(job, KEPT_FILE_LOST)
            # Any stranger's file may bring any mistake of ours; the guard takes a dead task for a hang.
            except Exception:
                logger.exception("Import %s stopped at a mistake of our own", job.manifest.id)
                _break(job, FAILED_INSIDE)
        if job.end is not None and job.end_again_ns <= time.monotonic_ns() and job.shift == self._shift:
            await self._end(job, job.end)

    async def _wave(self, job: Job) -> State | None:
        """Book the next rows; return the state in which the import ends, None while it goes on."""
        self._component.beat()
        if not job.ahead and not await self._read_ahead(job):
            if job.progress.done != job.total:
                raise RowsLostError
            return after(State.COMMITTING, Trigger.LAST_ROW)
        first = job.progress.done + 1
        if job.shift != self._shift:
            return None  # left behind while it was reading: the rows are another's
        free = self._free(job, first)
        if free == 0:
            await self._file(job, first)
            return None
        wave = [job.ahead.popleft() for _ in range(free)]
        rows = (self._row(job, n, row) for n, row in enumerate(wave, first))
        # Exceptions come as outcomes, so that no row is still at work when a neighbour's bug ends the import.
        outcomes = await self._beating(asyncio.gather(*rows, return_exceptions=True), job.shift)
        if job.shift != self._shift:
            return None
        for settled, outcome in enumerate(outcomes):
            if isinstance(outcome, BaseException):
                raise outcome
            if isinstance(outcome, Stopped):
                # What is not settled is next again: a row's key is its place, and places don't move.
                job.ahead.extendleft(reversed(wave[settled:]))
                await asyncio.sleep(AGAIN_AFTER_S)
                break
            job.progress = settle(job.progress, outcome)
            self._component.done()
        await self._tell(job)
        return None

    def _free(self, job: Job, first: int) -> int:
        """Return how many of the next rows, from the one at `first`, may be booked now: none behind a suspect."""
        most = min(IN_FLIGHT_MAX, len(job.ahead))
        if not self._suspected.any:
            return most
        keys = (judging.key_of(job.manifest, first + n) for n in range(most))
        return next((n for n, key in enumerate(keys) if self._suspected.holds(name_of(key))), most)

    async def _file(self, job: Job, ordinal: int) -> None:
        """Have an import wait for the trial of its next row. All suspects that a dead wave can have had are filed with it."""
        last = min(ordinal + IN_FLIGHT_MAX - 1, job.total)
        rows = [row for n in range(ordinal, last + 1) if self._suspected.holds((row := _held(job, n)).name)]
        next_name = name_of(judging.key_of(job.manifest, ordinal))
        if job.waits_for != next_name:  # else it has waited for long: whoever was told may be gone
            rows = [row for row in rows if row.name not in job.filed]
        filed = not rows or await self._apart(partial(self._suspected.file, rows))
        if filed:
            job.filed.update(row.name for row in rows)
        job.waits_for = next_name
        job.file_again_ns = time.monotonic_ns() + (SAY_AGAIN_NS if filed else END_AGAIN_AFTER_NS)

    async def _read_ahead(self, job: Job) -> bool:
        """Parse the next rows, some at a time so that a core may leave in between; False where none are left."""
        try:
            some = await self._apart(partial(_some, job.rows))
        except (OSError, msgspec.MsgspecError) as error:
            raise RowsLostError from error
        settled = max(0, job.progress.done - job.parsed)
        job.parsed += len(some)
        job.ahead.extend(some[settled:])
        return bool(some)

    async def _row(self, job: Job, ordinal: int, result: Result) -> Outcome | SkippedRow:
        manifest = job.manifest
        judged = judging.judge(result, manifest.currency)
        if not isinstance(judged, Candidate):
            return judged
        entry_id = self._service.new_id()
        command = judging.command_of(judged, ordinal, manifest, entry_id)
        if isinstance(command, Rejection):
            return refused(judged, command)
        key = judging.key_of(manifest, ordinal)
        # A stranger's lock on the store and a free slot come without an event to wait for.
        while (outcome := await self._book(judged, command, key)) is None:
            if self._is_over(job.shift):
                return Stopped()
            await asyncio.sleep(AGAIN_AFTER_S)
        return outcome

    async def _book(self, candidate: Candidate, command: RecordEntry, key: str) -> Outcome | None:
        """Ask the ledger once; None where it could not be asked now."""
        transaction_id, account_ids = command.id, accounts_of(command)
        account_id = ids_shown(account_ids)  # noqa: F841  for whoever asks for tasks
        payload = judging.payload_of(candidate)
        with holding_slot(
            self._service,
            KIND,
            payload,
            key=key,
            command_id=transaction_id,
            transaction_id=transaction_id,
            account_ids=account_ids,
        ) as held:
            if isinstance(held, Draining):
                return Stopped()
            if isinstance(held, NoSlot):
                return None
            answer = await self._service.carry_out(
                command, key, key.encode(), transaction_id, held.slot, kind=KIND, body_bytes=len(payload)
            )
            held.status, outcome = meaning_of(answer, candidate)
        return outcome

    async def _tell(self, job: Job) -> None:
        now_ns = time.monotonic_ns()
        if now_ns - job.told_ns >= TELL_EVERY_NS:
            job.told_ns = now_ns
            await self._keep(job)
            self._service.hub.tell([frame_of(job)])

    async def _end(self, job: Job, state: State) -> None:
        """Write the end down and tell it; where it can't be written, the import stays, to be ended later."""
        ended = msgspec.structs.replace(job.manifest, state=state)
        try:
            # Durable and in this order: no end without its numbers.
            is_wanted = partial(self._is_at_work, job.shift)
            keep = partial(job.folder.keep_progress, job.progress, durable=True, is_wanted=is_wanted)
            await self._apart(keep)
            if job.shift != self._shift:
                return
            await self._apart(partial(job.folder.keep_manifest, ended, is_wanted))
        except OSError as error:
            if not job.end_again_ns:
                logger.warning("The end of import %s could not be kept: %s", ended.id, error.strerror)
            job.end_again_ns = time.monotonic_ns() + END_AGAIN_AFTER_NS
            return
        if job.shift != self._shift:
            return  # whoever has its jobs now ends it alike
        job.manifest = ended
        self._jobs.remove(job)
        self._service.hub.tell([frame_of(job)])

    async def _keep(self, job: Job) -> None:
        """Write down how far it is. A full disk costs a later life some asking again, and this one nothing."""
        try:
            is_wanted = partial(self._is_at_work, job.shift)
            keep = partial(job.folder.keep_progress, job.progress, durable=False, is_wanted=is_wanted)
            await self._apart(keep)
        except OSError as error:
            logger.warning("How far import %s is could not be kept: %s", job.manifest.id, error.strerror)

    async def _beating(self, work: asyncio.Future[T], shift: int) -> T:
        """Wait for the writer, and beat meanwhile: it has a watch of its own."""
        while not work.done():
            await asyncio.wait({work}, timeout=BEAT_S)
            if shift == self._shift:
                self._component.beat()
        return work.result()


def _anew(job: Job, shift: int) -> Job:
    """Return a job of its own for another shift, at the last row that was settled."""
    made = Job(job.folder, job.manifest, job.total, job.rows_anew(), job.progress)
    made.end, made.waiting, made.rows_anew, made.shift = job.end, job.waiting, job.rows_anew, shift
    return made


def broken(folder: ImportFolder, manifest: Manifest, progress: Progress, fault: str) -> Job:
    """Return an import that can't be gone on with; the importer writes its end down."""
    job = Job(folder, manifest, progress.done, iter(()), progress)
    _break(job, fault)
    return job


def _break(job: Job, fault: str) -> None:
    job.manifest = msgspec.structs.replace(job.manifest, fault=fault)
    job.end = after(State.COMMITTING, Trigger.BROKE)


def frame_of(job: Job) -> Frame:
    """Return what an open page is told of an import."""
    wish, now = job.manifest, job.progress
    return frames.progress(
        wish.id, wish.state.value, now.done, job.total, now.duplicates, now.refused, job.waiting
    )


def _held(job: Job, ordinal: int) -> HeldRow:
    key = judging.key_of(job.manifest, ordinal)
    return HeldRow(name_of(key), key, job.manifest.id, ordinal)


def _some(rows: Iterator[Result]) -> list[Result]:
    return list(islice(rows, READ_AHEAD_ROWS))
