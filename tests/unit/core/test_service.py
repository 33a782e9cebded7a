"""The service: slots that always come back, and a core that leaves."""

import asyncio
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
from sqlalchemy import Connection
from starlette.requests import Request

from core.guarded.recorder import NoRecorder
from core.journal.answers import Done
from core.journal.store import LEDGER_FILE, open_reading
from core.journal.verify import Verdict
from core.service import Service
from core.settings import Settings
from core.slots import Draining
from core.web.asking import working
from core.web.problems import Problem, ProblemError
from tests import waiting
from tests.unit.core.books import Pen, opening
from tests.unit.core.test_writer import Heard, writing


@asynccontextmanager
async def serving(path: Path) -> AsyncIterator[Service]:
    made = Pen(path)
    async with writing(made, Heard()) as writer:
        readers = open_reading(path / LEDGER_FILE, 2, 1_000)
        yield Service(writer, readers, made.recorder, Settings(), made.epoch)


class Notes(NoRecorder):
    """Remembers with which status each piece of work was finished."""

    def __init__(self) -> None:
        super().__init__()
        self.finished: list[int] = []

    def finish(self, slot: int, status: int) -> None:
        super().finish(slot, status)
        self.finished.append(status)


def test_a_slot_comes_back_with_the_status_of_the_answer_however_the_work_ends(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with serving(tmp_path) as service:
            notes = service._recorder = Notes()
            app = SimpleNamespace(state=SimpleNamespace(service=service))
            request = Request({"type": "http", "app": app})
            with working(request, "test", b"") as held:
                held.status = 201
            for problem, status in (("store-busy", 503), ("entry-changed", 409), ("unbalanced", 422)):
                with pytest.raises(ProblemError), working(request, "test", b""):
                    raise ProblemError(Problem(problem))
                assert notes.finished[-1] == status
            with pytest.raises(ZeroDivisionError), working(request, "test", b""):
                raise ZeroDivisionError
            assert notes.finished == [201, 503, 409, 422, 500]
            assert service.in_flight == 0
            service.drain()
            with pytest.raises(ProblemError) as refused, working(request, "test", b""):
                pass
            assert refused.value.problem.slug == "leaving"
            assert len(notes.finished) == 5
            await service.close()
            notes.close()

    asyncio.run(scenario())


def test_what_a_new_answer_claims_is_told_and_a_replay_claims_nothing_of_this_life(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with serving(tmp_path) as service:
            told: list[int] = []
            notes: Any = SimpleNamespace(answered=told.append)
            service._recorder = notes
            command = opening("a")
            first, again = [await service.carry_out(command, "key", b"d" * 32, "c", 0) for _ in range(2)]
            assert isinstance(first, Done)
            assert first.commit is not None
            assert again == msgspec.structs.replace(first, replayed=True, commit=None)
            assert told == [service.head_seq]

    asyncio.run(scenario())


def test_a_proof_that_a_leaving_core_gives_up_was_not_begun(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with serving(tmp_path) as service:
            assert isinstance(await service.verify(), Verdict)
            asked = asyncio.ensure_future(service.verify())
            await asyncio.sleep(0)  # it is asked, and not begun
            service.drain()
            assert isinstance(await asked, Draining)
            assert isinstance(await service.verify(), Draining)
            await service.close()

    asyncio.run(scenario())


def test_the_loop_goes_on_while_the_service_closes(tmp_path: Path) -> None:
    goes_on = threading.Event()

    def wait(_: Connection) -> bool:
        return goes_on.wait(waiting.WAIT_S)

    async def scenario() -> None:
        async with serving(tmp_path) as service:
            slot = service.begin("read", b"")
            assert isinstance(slot, int)
            reading = asyncio.ensure_future(service.read(slot, wait))
            await asyncio.sleep(0)  # it is with the reader's thread
            service.drain()
            closing = asyncio.ensure_future(service.close())
            await asyncio.sleep(0)
            asyncio.get_running_loop().call_soon(goes_on.set)
            await closing
            assert await reading is True
            service.finish(slot, 200)

    asyncio.run(scenario())
