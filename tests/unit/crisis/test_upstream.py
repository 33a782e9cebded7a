"""Connections to a core, over a real socket: kept, paused, bounded, and closed with the truth."""

import asyncio
from pathlib import Path
from typing import Self, cast

import pytest

from hardcore.crisis import upstream
from hardcore.crisis.heads import AnswerHead
from hardcore.crisis.upstream import Pool, UpstreamConnection

ANSWER = b"HTTP/1.1 200 OK\r\nContent-Length: 3\r\nX-Core-Epoch: 1\r\n\r\nabc"
QUESTION = b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n"
WAIT_S = 20


class Question:
    """Asks once; `slow` pauses the connection with the first piece, and never asks it to go on."""

    def __init__(self, connection: UpstreamConnection, *, slow: bool = False) -> None:
        self.connection = connection
        self.body = b""
        self.slow = slow
        self.outcome: asyncio.Future[str] = asyncio.get_running_loop().create_future()

    async def ask(self) -> str:
        self.connection.ask(self, QUESTION, no_body=False, whole=True)
        return await asyncio.wait_for(self.outcome, WAIT_S)

    def headed(self, head: AnswerHead) -> None:
        assert head.epoch == 1

    def came(self, data: bytes) -> None:
        self.body += data
        if self.slow:
            self.connection.pause()

    def ended(self) -> None:
        self.outcome.set_result("ended")

    def lost(self) -> None:
        self.outcome.set_result("lost")

    def dropped(self) -> None:
        self.outcome.cancel()

    def garbled(self) -> None:
        self.outcome.set_result("garbled")

    def flowing(self, *, on: bool) -> None:
        """A question without a body."""


class Core:
    """Answers each question with `answer`; None: never."""

    def __init__(self, path: Path, answer: bytes | None = ANSWER) -> None:
        self.path = path
        self.answer = answer
        self.connections = 0
        self.freed = 0
        self._server: asyncio.Server | None = None
        self._pools: list[Pool] = []
        self._serving: set[asyncio.Task[None]] = set()

    async def __aenter__(self) -> Self:
        self._server = await asyncio.start_unix_server(self._serve, str(self.path))
        return self

    async def __aexit__(self, *_: object) -> None:
        assert self._server is not None
        for pool in self._pools:
            pool.close()
        self._server.close()
        await asyncio.wait_for(asyncio.gather(*self._serving), WAIT_S)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.connections += 1
        self._serving.add(cast("asyncio.Task[None]", asyncio.current_task()))
        try:
            while await reader.readuntil(b"\r\n\r\n"):
                if self.answer is not None:
                    writer.write(self.answer)
        except (asyncio.IncompleteReadError, ConnectionError):
            pass
        finally:
            writer.close()

    def _count(self) -> None:
        self.freed += 1

    def pool(self, *, most: int = 2, idle_ms: int = 60_000) -> Pool:
        loop = asyncio.get_running_loop()
        pool = Pool(loop, str(self.path), 1, connections_max=most, idle_ms=idle_ms, freed=self._count)
        self._pools.append(pool)
        return pool


async def _dial(pool: Pool) -> UpstreamConnection | None:
    dialled: asyncio.Future[UpstreamConnection | None] = asyncio.get_running_loop().create_future()
    pool.dial(dialled.set_result)
    return await asyncio.wait_for(dialled, WAIT_S)


async def _connected(pool: Pool) -> UpstreamConnection:
    connection = await _dial(pool)
    assert connection is not None
    return connection


def test_a_connection_that_was_paused_for_a_slow_reader_serves_the_next(tmp_path: Path) -> None:
    async def story() -> None:
        async with Core(tmp_path / "s") as core:
            pool = core.pool()
            assert await Question(await _connected(pool), slow=True).ask() == "ended"
            again = pool.idle()
            assert again is not None
            assert await Question(again).ask() == "ended"
            assert core.connections == 1

    asyncio.run(story())


def test_a_pool_has_room_up_to_its_bound_and_again_when_one_is_freed(tmp_path: Path) -> None:
    async def story() -> None:
        async with Core(tmp_path / "s", answer=None) as core:
            pool = core.pool(most=1)
            before = pool.room
            connection = await _connected(pool)
            taken = pool.room
            connection.abandon()
            assert (before, taken, pool.room) == (True, False, True)
            assert core.freed == 1

    asyncio.run(story())


def test_closing_a_pool_tells_every_asker_at_once(tmp_path: Path) -> None:
    async def story() -> None:
        async with Core(tmp_path / "s", answer=None) as core:
            pool = core.pool()
            question = Question(await _connected(pool))
            asked = asyncio.ensure_future(question.ask())
            await asyncio.sleep(0)  # the question is out
            pool.close()
            told = question.outcome.result()
            assert told == await asked == "lost"

    asyncio.run(story())


def test_a_core_that_refuses_is_told_to_whoever_dials(tmp_path: Path) -> None:
    async def story() -> None:
        core = Core(tmp_path / "nobody")
        assert await _dial(core.pool()) is None

    asyncio.run(story())


def test_a_dial_that_comes_after_the_pool_was_closed_brings_nothing(tmp_path: Path) -> None:
    async def story() -> None:
        async with Core(tmp_path / "s") as core:
            pool = core.pool()
            dialled: asyncio.Future[UpstreamConnection | None] = asyncio.get_running_loop().create_future()
            pool.dial(dialled.set_result)
            pool.close()
            assert await asyncio.wait_for(dialled, WAIT_S) is None

    asyncio.run(story())


def test_a_connection_that_ended_while_it_was_dialled_is_not_used(tmp_path: Path) -> None:
    async def story() -> None:
        async with Core(tmp_path / "s") as core:
            ended: list[asyncio.BaseTransport] = []

            class Refused(UpstreamConnection):
                """Ends as soon as it is made, before whoever dialled it runs again."""

                def connection_made(self, transport: asyncio.BaseTransport) -> None:
                    super().connection_made(transport)
                    ended.append(transport)
                    self.abandon()

            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(upstream, "UpstreamConnection", Refused)
                pool = core.pool(most=1)
                assert await _dial(pool) is None
            assert ended
            assert (await _connected(pool)).usable

    asyncio.run(story())


def test_a_connection_that_was_not_used_for_a_while_is_not_used_again(tmp_path: Path) -> None:
    async def story() -> None:
        async with Core(tmp_path / "s") as core:
            pool = core.pool(idle_ms=0)
            assert await Question(await _connected(pool)).ask() == "ended"
            pool.prune()
            assert pool.idle() is None

    asyncio.run(story())
