"""The switch between all and reads only: who may turn it, and what has to be committed before it goes back."""

import asyncio
import socket
import threading
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from core.guarded.beacon import Beacon
from core.journal import attestation
from core.journal.answers import Done, Exercise, KeyUnknown, OutcomeUnknown, ReadOnly
from core.journal.fence import Raised
from core.journal.store import LEDGER_FILE, open_reading
from core.journal.writer import Writer
from core.safety import Safety
from core.service import Service
from core.settings import Settings
from tests import waiting
from tests.unit.core.books import Pen, fenced, opened, opening, tamper
from tests.unit.core.test_writer import Heard, writing

FOR_EVER_NS = 3_600_000_000_000


class Switch:
    """A service with its switch, and the guard's end of the notify socket."""

    def __init__(self, folder: Path, made: Pen, writer: Writer, heard: Heard, settings: Settings) -> None:
        self.writer, self.heard = writer, heard
        self._ears = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._ears.bind(str(folder / "notify"))
        self._beacon = Beacon(str(folder / "notify"))
        readers = open_reading(folder / LEDGER_FILE, 2, 1_000)
        self.service = Service(writer, readers, made.recorder, settings, made.epoch)
        self.safety = Safety(self.service, writer, made.recorder, self._beacon)

    async def open(self, name: str, key: str | None = None) -> object:
        slot = self.service.begin("account.open", b"", key=key)
        assert isinstance(slot, int)
        answer = await self.service.carry_out(opening(name), key, b"d", "c", slot)
        self.service.finish(slot, 200)
        return answer

    async def look_up(self, key: str) -> object:
        slot = self.service.begin("command.look_up", b"", key=key)
        assert isinstance(slot, int)
        answer = await self.service.look_up(key, None, slot)
        self.service.finish(slot, 200)
        return answer

    def safe(self) -> str | None:
        return self.service.safe

    async def until(self, look: Callable[[], bool]) -> None:
        """The switch tells nobody but the guard, so it is looked at."""
        async with asyncio.timeout(waiting.WAIT_S):
            while not look():  # noqa: ASYNC110
                await asyncio.sleep(0.001)

    def told(self) -> list[bytes]:
        found = []
        while True:
            try:
                found.append(self._ears.recv(4096))
            except BlockingIOError:
                return found

    def close(self) -> None:
        self._beacon.close()
        self._ears.close()


@asynccontextmanager
async def switch(folder: Path, settings: Settings | None = None) -> AsyncIterator[Switch]:
    made, heard = Pen(folder), Heard()
    async with writing(made, heard) as writer:
        one = Switch(folder, made, writer, heard, settings or Settings())
        try:
            yield one
        finally:
            one.service.drain()
            await one.service.close()
            one.close()


def test_a_refusing_store_shuts_the_core_once_and_only_a_committed_write_opens_it(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with switch(tmp_path) as one:
            one.writer.pretend_full(time.monotonic_ns() + FOR_EVER_NS)
            assert await one.open("a") == ReadOnly("DISK_FULL")
            one.safety.shut(one.heard.shut[0])
            one.safety.shut(one.heard.shut[0])
            assert one.safe() == "DISK_FULL"
            assert one.told() == [b"X_STORE=FULL"]
            assert "DISK_FULL" in (await one.safety.switch(None) or "")
            assert one.safe() == "DISK_FULL"
            one.writer.pretend_full(0)
            assert await one.safety.switch(None) is None
            assert one.safe() is None
            assert one.told() == [b"X_STORE=OK"]
            assert isinstance(await one.open("a"), Done)

    asyncio.run(scenario())


def test_a_book_that_must_not_be_attested_is_told_unsound_and_no_core_opens_it_by_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(attestation, "EVENTS_BETWEEN", 2)

    async def scenario() -> None:
        async with switch(tmp_path, Settings(safe_again_ms=10)) as one:
            assert isinstance(await one.open("a"), Done)
            tamper(tmp_path, "UPDATE account SET posted = 5")
            for _ in range(2):
                assert await one.open("b") == ReadOnly("STORE_CORRUPT")
                one.safety.shut(one.heard.shut[-1])
                one.safety.shut(one.heard.shut[-1])
                assert one.safe() == "STORE_CORRUPT"
                (told,) = one.told()
                assert told.startswith(b"X_UNSOUND=The ledger is not whole: the accounts do not stand")
                trying = asyncio.create_task(one.safety.keep_trying(1))
                await asyncio.wait({trying}, timeout=0.05)
                trying.cancel()
                assert one.safe() == "STORE_CORRUPT"
                # A person's word opens it, up to the next booking after which it would have to be attested.
                assert await one.safety.switch(None) is None
                assert (one.safe(), one.told()) == (None, [])

    asyncio.run(scenario())


def test_a_guards_word_is_no_fault_of_the_store_and_none_is_told(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with switch(tmp_path) as one:
            assert await one.safety.switch("STORE_CORRUPT") is None
            assert await one.open("a") == ReadOnly("STORE_CORRUPT")
            assert await one.safety.switch(None) is None
            assert one.told() == []

    asyncio.run(scenario())


def test_the_newest_order_counts_also_when_an_older_one_ends_later(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with switch(tmp_path) as one:
            await one.safety.switch("DISK_STALLED")
            opening_again = asyncio.create_task(one.safety.switch(None))
            await asyncio.sleep(0)  # it stands in the writer's line
            await one.safety.switch("DISK_FULL")
            assert await opening_again == "Another order came meanwhile."
            assert one.safe() == "DISK_FULL"

    asyncio.run(scenario())


def test_what_stands_in_line_is_finished_and_its_key_is_told_only_then(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with switch(tmp_path) as one:
            first = asyncio.create_task(one.open("a", "k"))
            await asyncio.sleep(0)  # it stands in the writer's line
            await one.safety.switch("DISK_FULL")
            again, looked_up = await asyncio.gather(one.open("a", "k"), one.look_up("k"))
            done = await first
            assert isinstance(done, Done)
            assert again == looked_up == Done(done.status, done.body, replayed=True)
            assert await one.look_up("new") == KeyUnknown()
            assert await one.open("b", "new") == ReadOnly("DISK_FULL")

    asyncio.run(scenario())


def test_behind_a_writer_that_does_not_come_back_a_key_is_unknown_and_its_slot_is_free_again(
    tmp_path: Path,
) -> None:
    comes_back = threading.Event()

    async def scenario() -> None:
        async with switch(tmp_path, Settings(write_busy_ms=1)) as one:
            stuck = one.service.begin("drill", b"")
            assert isinstance(stuck, int)
            drilled = one.writer.submit(Exercise(stuck, "tx", "system:drill", comes_back.wait))
            try:
                first = asyncio.create_task(one.open("a", "k"))
                await asyncio.sleep(0)  # it stands in the writer's line
                await one.safety.switch("DISK_STALLED")
                assert await one.look_up("k") == OutcomeUnknown()
                assert await one.open("a", "k") == OutcomeUnknown()
                assert one.service.in_flight == 2  # the writer's two
                assert await one.look_up("other") == KeyUnknown()
            finally:
                comes_back.set()
            await drilled
            one.service.finish(stuck, 200)
            done = await first
            assert isinstance(done, Done)
            assert await one.look_up("k") == Done(done.status, done.body, replayed=True)
            assert one.service.head_seq == 1

    asyncio.run(scenario())


def test_a_command_whose_request_is_gone_is_still_in_line(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with switch(tmp_path) as one:
            leaving = asyncio.create_task(one.open("a", "k"))
            await asyncio.sleep(0)
            leaving.cancel()
            await one.safety.switch("DISK_FULL")
            assert isinstance(await one.look_up("k"), Done)

    asyncio.run(scenario())


def test_past_a_higher_epoch_nobody_is_told_that_nothing_was_done(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with switch(tmp_path) as one:
            await one.safety.switch("DISK_FULL")
            successor = opened(tmp_path)
            assert fenced(successor, None) == Raised(2)
            successor.close()
            successor.engine.dispose()
            assert await one.open("a", "k") == OutcomeUnknown()
            assert await one.look_up("k") == OutcomeUnknown()

    asyncio.run(scenario())


def test_a_core_that_nobody_guards_tries_by_itself_until_the_store_takes_writes(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with switch(tmp_path) as one:
            one.writer.pretend_full(time.monotonic_ns() + FOR_EVER_NS)
            await one.safety.switch("DISK_FULL")
            trying = asyncio.create_task(one.safety.keep_trying(5))
            await one.until(lambda: len(one.heard.shut) > 1)
            assert one.safe() == "DISK_FULL"
            one.writer.pretend_full(0)
            await one.until(lambda: one.safe() is None)
            trying.cancel()

    asyncio.run(scenario())
