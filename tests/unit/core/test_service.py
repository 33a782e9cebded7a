"""The service while its core leaves."""

import asyncio
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from sqlalchemy import Connection

from core.journal.store import LEDGER_FILE, open_reading
from core.journal.verify import Verdict
from core.service import Draining, Service
from core.settings import Settings
from tests import waiting
from tests.unit.core.books import Pen
from tests.unit.core.test_writer import Heard, writing


@asynccontextmanager
async def serving(path: Path) -> AsyncIterator[Service]:
    made = Pen(path)
    async with writing(made, Heard()) as writer:
        readers = open_reading(path / LEDGER_FILE, 2, 1_000)
        yield Service(writer, readers, made.recorder, Settings(), made.epoch)


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
