"""Waves: rows that go together have each its own answer, its own place and, after a death, its own turn."""

import asyncio
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from uuid import UUID

import pytest

from core.guarded.recorder import NoRecorder
from core.imports import judging, waves
from core.imports.folder import Imports
from core.imports.importer import Importer
from core.imports.jobs import ONE_BY_ONE_ROWS, TELL_ROWS_MAX, Job, anew
from core.imports.outcomes import FAILED_INSIDE, Booked, Outcome, Stopped
from core.imports.reading.candidates import Candidate, Result, Skip, SkippedRow
from core.imports.records import Manifest, Progress
from core.imports.states import State
from core.journal.answers import Answer, Done, KeyTaken, Order, StoreBusy
from core.rulings import Rulings

IMPORT = str(UUID(int=1))
DONE = Done(201, b'{"seq": 1}')
WISH = Manifest(IMPORT, State.COMMITTING, "bank.csv", 1, "00", 0, account="bank", currency="KRW")


class Writer:
    """Answers waves as it is told, and remembers who was asked for together and who alone."""

    def __init__(self) -> None:
        self.draining = False
        self.safe = None
        self.rulings = Rulings()
        self.hub = SimpleNamespace(tell=lambda _: None)
        self.together: list[list[int]] = []
        self.busy: set[int] = set()

    def new_id(self) -> str:
        return str(UUID(int=2))

    def begin(self, *_: Any, **__: Any) -> int:
        return 0

    def finish(self, *_: Any) -> None:
        pass

    async def carry_out_each(self, orders: Sequence[Order], _slot: int) -> Sequence[Answer]:
        asked = [int(str(order.key).rpartition(":")[2]) for order in orders]
        self.together.append(asked)
        await asyncio.sleep(0)
        answers = [StoreBusy() if n in self.busy else DONE for n in asked]
        self.busy = set()
        return answers


class Watched(Importer):
    """An importer whose rows that go by themselves are only counted."""

    def __init__(self, writer: Any) -> None:
        super().__init__(writer, NoRecorder())
        self.alone: list[int] = []

    async def _row(self, _job: Job, ordinal: int, _result: Result) -> Outcome | SkippedRow:
        self.alone.append(ordinal)
        return Booked()


def candidate(line: int) -> Candidate:
    return Candidate(line, ("a",), "2026-03-01", -500, "KRW", "shop", None, None, None, None, ("a",), line)


def rows(count: int) -> Iterator[Result]:
    return (candidate(line) for line in range(1, count + 1))


def job(data: Path, count: int, one_by_one: int = 0) -> Job:
    imports = Imports(data)
    imports.begin(IMPORT)
    imports.unfinished(IMPORT).keep_manifest(WISH)
    folder = imports.finish(IMPORT)
    return Job(folder, WISH, count, rows(count), Progress(), one_by_one=one_by_one)


def booked_by(writer: Writer, work: Job) -> Watched:
    async def work_on() -> Watched:
        importer = Watched(writer)
        importer.add(work)
        while importer.job(IMPORT) is not None:
            await importer._turn(work)
        return importer

    return asyncio.run(work_on())


def test_rows_go_together_and_each_once(tmp_path: Path) -> None:
    writer, work = Writer(), job(tmp_path, 2_000)
    importer = booked_by(writer, work)
    assert [n for wave in writer.together for n in wave] == list(range(1, 2_001))
    assert len(writer.together) < 2_000 / waves.ROWS_MIN
    assert (work.progress.done, work.progress.booked, importer.alone) == (2_000, 2_000, [])


def test_what_the_writer_could_not_take_is_asked_again_from_its_place(tmp_path: Path) -> None:
    writer, work = Writer(), job(tmp_path, 400)
    writer.busy = {30}
    booked_by(writer, work)
    flat = [n for wave in writer.together for n in wave]
    assert set(flat) == set(range(1, 401))
    assert flat.count(29) == 1
    assert flat.count(30) == 2
    assert work.progress == Progress(done=400, booked=400)


def test_rows_that_may_have_killed_a_core_go_one_by_one(tmp_path: Path) -> None:
    writer, work = Writer(), job(tmp_path, 400, one_by_one=100)
    importer = booked_by(writer, work)
    assert sorted(importer.alone)[:100] == list(range(1, 101))
    assert writer.together[0][0] == max(importer.alone) + 1
    assert work.progress == Progress(done=400, booked=400)


def test_a_shift_that_takes_over_goes_one_by_one(tmp_path: Path) -> None:
    work = job(tmp_path, 10)
    assert anew(work, 1).one_by_one == ONE_BY_ONE_ROWS


def test_more_can_not_have_been_at_work_than_go_one_by_one_afterwards() -> None:
    # The note on the disk may lag so far and a wave behind; of two more one is being counted, one written.
    assert ONE_BY_ONE_ROWS >= TELL_ROWS_MAX + 3 * waves.ROWS_MAX


def test_a_row_at_which_we_stumble_ends_the_wave_before_it_and_the_import_at_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = judging.judge

    def judge(result: Result, currency: str | None) -> Any:
        if result.line == 50:
            raise ValueError(result.line)
        return whole(result, currency)

    class Stumbling(Watched):
        async def _row(self, job: Job, ordinal: int, result: Result) -> Outcome | SkippedRow:
            judging.judge(result, job.manifest.currency)
            return await super()._row(job, ordinal, result)

    monkeypatch.setattr(judging, "judge", judge)
    monkeypatch.setitem(globals(), "Watched", Stumbling)
    work = job(tmp_path, 100)
    booked_by(Writer(), work)
    assert work.progress == Progress(done=49, booked=49)
    assert (work.manifest.state, work.manifest.fault) == (State.FAILED, FAILED_INSIDE)


def test_what_needs_no_ledger_stands_between_what_does() -> None:
    skipped = SkippedRow(2, ("",), Skip.BLANK)
    wave = waves.prepare([candidate(1), skipped, candidate(3), candidate(4)], 1, WISH, lambda: "id")
    assert [order.key for order in wave.orders] == [f"{IMPORT}:{n}" for n in (1, 3, 4)]
    first, second, third, fourth = waves.outcomes(wave, [DONE, KeyTaken(), StoreBusy()])
    assert isinstance(first, Booked)
    assert second is skipped
    assert getattr(third, "reason", "") == FAILED_INSIDE
    assert isinstance(fourth, Stopped)


def test_without_answers_nothing_is_settled_that_was_asked() -> None:
    skipped = SkippedRow(1, ("",), Skip.BLANK)
    wave = waves.prepare([skipped, candidate(2)], 1, WISH, lambda: "id")
    one, two = waves.outcomes(wave, None)
    assert one is skipped
    assert isinstance(two, Stopped)


@pytest.mark.parametrize(
    ("rows_", "took_ms", "size", "following"),
    [(64, 32, 64, 64), (64, 8, 64, 128), (64, 500, 64, 32), (16, 500, 16, waves.ROWS_MIN)],
)
def test_a_wave_is_as_large_as_the_time_it_may_take(
    rows_: int, took_ms: int, size: int, following: int
) -> None:
    assert waves.next_size(rows_, took_ms * 1_000_000, size) == following
