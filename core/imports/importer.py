"""The importer: a component of its own that books the rows of committed imports, and goes on after a death.

It is one task with its own beat on the recorder page, beside the requests and not among them: rows enter the
ledger by the same door as everybody's commands, many as one wave (`waves`) or, where somebody may have to be named, a few
by themselves, and never so many that a person's request waits behind a file. A row's key is the import's id and its place in the
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
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import islice
from typing import Final, TypeVar, assert_never

import msgspec

from core.alone import alone
from core.guarded.naming import ids_shown
from core.guarded.poison import name_of
from core.guarded.recorder import FlightRecorder
from core.imports import judging, waves
from core.imports.jobs import TELL_ROWS_MAX, Job, RowsLostError, anew, break_off, ended, frame_of, row_held
from core.imports.outcomes import BUSY, FAILED_INSIDE, Outcome, Stopped, meaning_of, refused, settle
from core.imports.reading.candidates import Candidate, Result, SkippedRow
from core.imports.states import State, Waiting
from core.imports.suspected import Suspected
from core.journal.answers import CREATED, Answer
from core.ledger.commands import accounts_of
from core.ledger.entries import RecordEntry
from core.ledger.reasons import Rejection
from core.rulings import WORD_EVERY_S
from core.service import Service
from core.slots import Draining, NoSlot, holding_slot

T = TypeVar("T")

IN_FLIGHT_MAX: Final = 16  # of 256 slots: the rest is everybody else's
READ_AHEAD_ROWS: Final = 512
WAVES_A_TURN: Final = 16  # of one import; more than one take turns, wave by wave
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
        self._size = 4 * waves.ROWS_MIN

    def start(self) -> None:
        """Work from now on; also again after `stop`, which may not have come to its end yet."""
        self._resting = False
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._run(self._shift), name=COMPONENT)

    def begin_anew(self) -> None:
        """Leave the shift that hangs behind, and go on with all imports where it was."""
        self._shift += 1
        self._stalls = False
        self._jobs = deque(anew(job, self._shift) for job in self._jobs)
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
        # Whoever knew of a death may say whom he suspects after this core has opened its book.
        while not self._suspected.is_named and not self._is_over(shift):  # noqa: ASYNC110  # time ends it as well
            await asyncio.sleep(WORD_EVERY_S)
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
                break_off(job, KEPT_FILE_LOST)
            # Any stranger's file may bring any mistake of ours; the guard takes a dead task for a hang.
            except Exception:
                logger.exception("Import %s stopped at a mistake of our own", job.manifest.id)
                break_off(job, FAILED_INSIDE)
        if job.end is not None and job.end_again_ns <= time.monotonic_ns() and job.shift == self._shift:
            await self._end(job, job.end)

    async def _wave(self, job: Job) -> State | None:
        """Book the next rows; return the state in which the import ends, None while it goes on."""
        self._component.beat()
        first = job.progress.done + 1
        if self._goes_together(job):
            return await self._together(job, first)
        if job.next is not None:
            job.ahead.extendleft(reversed(job.next.rows))
            job.next = None
        if not job.ahead and not await self._read_ahead(job):
            return ended(job)
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
        await self._settle(job, wave, outcomes)
        await self._tell(job)
        return None

    async def _settle(
        self, job: Job, rows: Sequence[Result], outcomes: Iterable[waves.Settled | BaseException]
    ) -> None:
        """Take what became of these rows, up to the first that has to be asked again."""
        for settled, outcome in enumerate(outcomes):
            if isinstance(outcome, BaseException):
                raise outcome
            if isinstance(outcome, Stopped):
                # What is not settled is next again: a row's key is its place, and places don't move.
                if job.next is not None:
                    job.ahead.extendleft(reversed(job.next.rows))
                    job.next = None
                job.ahead.extendleft(reversed(rows[settled:]))
                await asyncio.sleep(AGAIN_AFTER_S)
                return
            job.progress = settle(job.progress, outcome)
            self._component.done()

    def _goes_together(self, job: Job) -> bool:
        """Whether the next rows may be one piece of work: nobody may have to be named, now or after a death."""
        return job.progress.done >= job.one_by_one and not (
            self._suspected.any or self._service.rulings.want_names
        )

    async def _together(self, job: Job, first: int) -> State | None:
        """Book some waves, each as one piece of work; none of them is still at the writer when this is over."""
        now = job.next or await self._prepare(job, first)
        job.next = None
        if job.shift != self._shift:
            return None
        if now is None:
            return ended(job)
        asking, began_ns = asyncio.ensure_future(self._ask_together(job, now)), time.monotonic_ns()
        for left in reversed(range(WAVES_A_TURN)):
            # The next one is prepared while this one is written, and whatever goes wrong there waits for what this one has.
            preparing = asyncio.gather(self._prepare(job, now.first + len(now.rows)), return_exceptions=True)
            [made] = await preparing
            answers = await self._beating(asking, job.shift)
            if job.shift != self._shift:
                return None
            self._size = waves.next_size(len(now.rows), time.monotonic_ns() - began_ns, self._size)
            outcomes = list(waves.outcomes(now, answers))
            goes_on = left > 0 and self._goes_on(job, outcomes)
            job.next = made if isinstance(made, waves.Wave) else None
            following = job.next if goes_on else None
            if following is not None:  # before anything is counted: the writer need not wait for that
                asking, began_ns = (
                    asyncio.ensure_future(self._ask_together(job, following)),
                    time.monotonic_ns(),
                )
                job.next = None
            await self._settle(job, now.rows, outcomes)
            await self._tell(job)
            if isinstance(made, BaseException):
                raise made
            if following is None:
                return None
            now = following
        raise AssertionError("the last wave of a turn is followed by none")

    def _goes_on(self, job: Job, outcomes: Sequence[waves.Settled]) -> bool:
        """Whether the wave after one of which this came may go to the writer in the same turn."""
        stopped = any(isinstance(outcome, Stopped) for outcome in outcomes)
        return (
            not stopped and len(self._jobs) == 1 and not self._is_over(job.shift) and self._goes_together(job)
        )

    async def _prepare(self, job: Job, first: int) -> waves.Wave | None:
        """Read the rows from the one at `first` on and make a wave of them; None where none are left."""
        while not job.ahead:
            if not await self._read_ahead(job):
                return None
        rows = [job.ahead.popleft() for _ in range(min(self._size, len(job.ahead)))]
        wave = await self._apart(partial(waves.prepare, rows, first, job.manifest, self._service.new_id))
        if len(wave.rows) < len(rows):
            job.one_by_one = first + len(rows)
            job.ahead.extendleft(reversed(rows[len(wave.rows) :]))
        return wave

    async def _ask_together(self, job: Job, wave: waves.Wave) -> Sequence[Answer] | None:
        """Ask the ledger for all rows of a wave at once; None where it could not be asked now."""
        if not wave.orders:
            return ()
        account_id = job.manifest.account or ""
        payload = waves.payload_of(wave)
        # No key and no name: whoever dies of one of its rows has not died of it, and finds out which by going one by one.
        with holding_slot(self._service, KIND, payload, account_ids=(account_id,)) as held:
            if isinstance(held, NoSlot | Draining):
                return None
            answers = await self._service.carry_out_each(wave.orders, held.slot)
            held.status = CREATED if answers is not None else BUSY
        return answers

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
        rows = [
            row for n in range(ordinal, last + 1) if self._suspected.holds((row := row_held(job, n)).name)
        ]
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
        rows = job.progress.done - job.told_rows
        if now_ns - job.told_ns >= TELL_EVERY_NS or rows >= TELL_ROWS_MAX:
            job.told_ns, job.told_rows = now_ns, job.progress.done
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


def _some(rows: Iterator[Result]) -> list[Result]:
    return list(islice(rows, READ_AHEAD_ROWS))
