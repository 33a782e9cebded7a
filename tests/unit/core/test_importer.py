"""The importer and the desk between two moments: what is settled, what is next, and who may sweep meanwhile."""

import asyncio
import errno
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from uuid import UUID

import pytest

from core.guarded.recorder import NoRecorder
from core.imports.desk import Desk
from core.imports.folder import Imports
from core.imports.importer import Importer
from core.imports.jobs import Job
from core.imports.outcomes import FAILED_INSIDE, Booked, Outcome, Stopped
from core.imports.reading.candidates import Candidate, Result, SkippedRow
from core.imports.records import Manifest, Progress
from core.imports.states import State
from core.imports.suspected import Suspected
from core.settings import Settings

IMPORT = str(UUID(int=1))


class Scripted(Importer):
    """An importer whose rows end as they are told: by a bug, by leaving, or booked."""

    def __init__(self, suspected: Suspected | None = None) -> None:
        hub: Any = SimpleNamespace(tell=lambda _: None)
        service: Any = SimpleNamespace(hub=hub, draining=False)
        super().__init__(service, NoRecorder(), suspected)
        self.bad: set[int] = set()
        self.leaving: set[int] = set()
        self.booked: list[tuple[int, int]] = []

    async def _row(self, _job: Job, ordinal: int, result: Result) -> Outcome | SkippedRow:
        if ordinal in self.bad:
            raise ValueError(ordinal)
        if ordinal in self.leaving:
            return Stopped()
        await asyncio.sleep(0)
        self.booked.append((ordinal, result.line))
        return Booked()


def rows(count: int) -> Iterator[Result]:
    return (
        Candidate(line, ("a",), "2026-03-01", -500, "KRW", "shop", None, None, None, None, ("a",), 1)
        for line in range(1, count + 1)
    )


def job(data: Path, count: int) -> Job:
    imports = Imports(data)
    made = Manifest(IMPORT, State.COMMITTING, "bank.csv", 1, "00", 0, account="bank", currency="KRW")
    imports.begin(IMPORT)
    imports.unfinished(IMPORT).keep_manifest(made)
    return Job(imports.finish(IMPORT), made, count, rows(count), Progress(), one_by_one=count)


def test_a_mistake_in_one_row_leaves_none_of_its_neighbours_at_work(tmp_path: Path) -> None:
    importer, work = Scripted(), job(tmp_path, 16)
    importer.bad = {3}
    importer.add(work)
    asyncio.run(importer._turn(work))
    assert len(importer.booked) == 15
    assert work.progress == Progress(done=2, booked=2)
    kept = work.folder.manifest()
    assert kept is not None
    assert (kept.state, kept.fault) == (State.FAILED, FAILED_INSIDE)
    assert work.folder.progress() == work.progress


def test_a_row_keeps_its_place_when_those_before_it_are_asked_again(tmp_path: Path) -> None:
    importer, work = Scripted(), job(tmp_path, 20)
    importer.leaving = {5}
    importer.add(work)

    async def work_on() -> None:
        await importer._turn(work)
        importer.leaving = set()
        while importer.job(IMPORT) is not None:
            await importer._turn(work)

    asyncio.run(work_on())
    assert {ordinal - line for ordinal, line in importer.booked} == {0}
    assert {ordinal for ordinal, _ in importer.booked} == set(range(1, 21))
    assert work.progress == Progress(done=20, booked=20)


def test_nothing_is_swept_away_while_a_wish_is_being_kept(tmp_path: Path) -> None:
    imports = Imports(tmp_path)
    imports.begin(IMPORT)
    old = Manifest(IMPORT, State.PREVIEW, "bank.csv", 1, "00", made_ns=1)
    imports.unfinished(IMPORT).keep_manifest(old)
    folder = imports.finish(IMPORT)
    service: Any = SimpleNamespace(settings=Settings())
    assert old.made_ns < time.time_ns()

    async def keep() -> None:
        asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor(1))
        desk = Desk(service, NoRecorder(), tmp_path)
        async with desk._changing:
            sweeping = asyncio.create_task(desk._take_up())
            for _ in range(10):  # one thread: what the sweeping has asked for is done before this is
                await asyncio.to_thread(lambda: None)
            committed = Manifest(IMPORT, State.COMMITTING, "bank.csv", 1, "00", made_ns=1)
            folder.keep_manifest(committed)
        await sweeping

    asyncio.run(keep())
    kept = folder.manifest()
    assert kept is not None
    assert kept.state is State.COMMITTING


def test_a_disk_that_fails_under_old_imports_keeps_nobody_from_new_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unreadable(_: Imports) -> None:
        raise OSError(errno.EIO, "the folder can't be listed")

    monkeypatch.setattr(Imports, "newest_first", unreadable)
    service: Any = SimpleNamespace(settings=Settings(), safe=None, draining=False)

    async def scenario() -> None:
        desk = Desk(service, NoRecorder(), tmp_path)
        await desk.start()
        assert isinstance(await desk.begin(IMPORT), Path)
        await desk.end(IMPORT)
        await desk.stop()

    asyncio.run(scenario())


def test_a_first_look_that_hangs_is_work_that_stands_still() -> None:
    held, looking = threading.Event(), threading.Event()
    said: list[bool] = []

    class Held(Suspected):
        def look_again(self) -> None:
            looking.set()
            held.wait()

    async def scenario() -> None:
        importer = Scripted(Held())
        beats: Any = SimpleNamespace(works=said.append, beat=lambda: None, done=lambda: None)
        importer._component = beats
        importer.start()
        await asyncio.to_thread(looking.wait)
        assert said == [True]
        held.set()
        await importer.stop()
        assert said == [True, False]

    try:
        asyncio.run(scenario())
    finally:
        held.set()
