"""Draining, where it is stuck: what is taken back, and what can't be."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from threading import Event
from typing import NoReturn

import pytest

from core.draining import LEAVING, Drain
from core.guarded.recorder import LifeState
from core.imports.desk import Desk
from core.journal.answers import Done, Exercise
from core.journal.store import LEDGER_FILE, open_reading
from core.journal.verify import GivenUp
from core.service import Service
from core.settings import Settings
from core.slots import Draining
from tests import waiting
from tests.unit.core.books import Pen, opening
from tests.unit.core.test_writer import Heard, ask, writing


class Stuck(Exception):  # noqa: N818  it is told by this name in the tests
    """The process would have ended here."""


class Scene:
    """A service with its desk, a writer, and what came of a drain."""

    def __init__(self, made: Pen, service: Service, desk: Desk, drain: Drain) -> None:
        self.made, self.service, self.desk, self.drain = made, service, desk, drain


@asynccontextmanager
async def scene(path: Path, let_go: list[bool]) -> AsyncIterator[Scene]:
    def stuck() -> NoReturn:
        raise Stuck

    made = Pen(path)
    async with writing(made, Heard()) as writer:
        service = Service(
            writer, open_reading(path / LEDGER_FILE, 2, 1_000), made.recorder, Settings(), made.epoch
        )
        desk = Desk(service, made.recorder, path)
        await desk.start()
        drain = Drain(service, desk, writer, made.recorder, lambda: let_go.append(True), stuck)
        yield Scene(made, service, desk, drain)
        service.drain()
        await desk.stop()
        await service.end_threads()


def test_a_drained_core_lets_go_once_and_says_so_again(tmp_path: Path) -> None:
    async def scenario() -> None:
        let_go: list[bool] = []
        async with scene(tmp_path, let_go) as now:
            assert await now.drain.within(10_000) == now.service.head_seq
            assert await now.drain.within(10_000) == now.service.head_seq
            assert let_go == [True]
            assert isinstance(now.service.begin("read.x", b""), Draining)

    asyncio.run(scenario())


def test_nothing_is_proven_behind_a_drained_core(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with scene(tmp_path, []) as now:
            before = now.service.is_laid_down
            assert isinstance(await now.drain.within(10_000), int)
            assert (before, now.service.is_laid_down) == (False, True)
            assert isinstance(await now.service.auditor.verify_behind(), GivenUp)

    asyncio.run(scenario())


def test_a_writer_that_is_stuck_with_nobody_waiting_for_it_is_not_waited_for_either(tmp_path: Path) -> None:
    async def scenario() -> None:
        goes_on = Event()
        let_go: list[bool] = []
        async with scene(tmp_path, let_go) as now:
            writer = now.drain._writer
            assert writer is not None
            slot = now.made.recorder.begin("c", None, "drill", "", (), b"", 0)
            assert slot is not None
            stuck = writer.submit(Exercise(slot, "c", "a", lambda: goes_on.wait(waiting.WAIT_S)))
            refused = await now.drain.within(50)
            assert refused == "Not drained in time: the writer is not done."
            assert let_go == []
            assert now.made.recorder._words[336 >> 3] == LifeState.READY
            goes_on.set()
            assert isinstance(await stuck, Done)
            again = await ask(writer, now.made, opening("after"))
            assert isinstance(again, Done), "it takes work as before"
            assert isinstance(await now.drain.within(10_000), int)

    asyncio.run(scenario())


def test_a_core_that_leaves_takes_nothing_back(tmp_path: Path) -> None:
    async def scenario() -> None:
        let_go: list[bool] = []
        async with scene(tmp_path, let_go) as now:
            slot = now.service.begin("read.x", b"")
            assert isinstance(slot, int)
            draining = asyncio.ensure_future(now.drain.within(10_000))
            while not now.service.draining:  # noqa: ASYNC110  it has no word for it
                await asyncio.sleep(0)
            assert isinstance(await now.drain.within(10), str), "one order at a time"
            now.drain.leave()
            now.service.drain()
            now.service.finish(slot, 200)
            assert await draining == LEAVING
            assert await now.drain.within(10) == LEAVING
            assert now.service.draining
            assert let_go == []

    asyncio.run(scenario())


def test_an_upload_that_has_begun_is_waited_for_and_none_begins(tmp_path: Path) -> None:
    async def scenario() -> None:
        let_go: list[bool] = []
        async with scene(tmp_path, let_go) as now:
            first, second = now.desk.name("first"), now.desk.name("second")
            assert isinstance(await now.desk.begin(first), Path)
            refused = await now.drain.within(50)
            assert refused == "Not drained in time: imports and uploads are at work."
            draining = asyncio.ensure_future(now.drain.within(10_000))
            await asyncio.sleep(0)
            trouble = await now.desk.begin(second)
            assert not isinstance(trouble, Path)
            assert trouble.slug == "leaving"
            assert isinstance(now.service.begin("read.x", b""), int), "what an upload asks is answered"
            now.service.finish(0, 200)
            await now.desk.end(first)
            assert isinstance(await draining, int)

    asyncio.run(scenario())


def test_a_store_that_does_not_close_ends_the_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario() -> None:
        goes_on = Event()
        let_go: list[bool] = []
        monkeypatch.setattr("core.draining.CLOSING_S", 0.05)
        async with scene(tmp_path, let_go) as now:
            journal = now.made.journal
            closed = journal.close
            monkeypatch.setattr(journal, "close", lambda: goes_on.wait(waiting.WAIT_S) and closed())
            with pytest.raises(Stuck):
                await now.drain.within(50)
            goes_on.set()
            assert let_go == []

    asyncio.run(scenario())
