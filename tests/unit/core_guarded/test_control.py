"""The core's control socket: who may say what, and how little anybody can do to it."""

import asyncio
import contextlib
import json
import os
import socket
import stat
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from core.guarded.control import (
    CONNECTIONS_MAX,
    LINE_BYTES_MAX,
    ControlServer,
    ControlUnboundError,
    bind_private,
)
from tests.unit.core_guarded.guest import Bare


def test_the_socket_is_private_from_its_first_moment(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        with bind_private(tmp_path / "control"):
            assert stat.S_IMODE((tmp_path / "control").stat().st_mode) == 0o600
            with pytest.raises(OSError, match="in use"):
                bind_private(tmp_path / "control")
    finally:
        os.umask(before)


def test_a_taken_path_is_told_apart_from_every_other_fault(tmp_path: Path) -> None:
    (tmp_path / "control").touch()
    server = ControlServer(tmp_path / "control", Bare(), lambda _code, _text: None)
    with pytest.raises(ControlUnboundError, match="in use"):
        asyncio.run(server.open())


def served(path: Path, talk: Callable[[Path], Awaitable[None]], silence_s: float = 10.0) -> None:
    """Run `talk` against a server on `path`; afterwards the socket is gone."""

    async def run() -> None:
        server = ControlServer(path, Bare(), lambda _code, _text: None, silence_s)
        await server.open()
        try:
            async with asyncio.timeout(30):
                await talk(path)
        finally:
            await server.close()

    asyncio.run(run())
    assert not path.exists()


async def say(path: Path, *lines: bytes) -> list[bytes]:
    """Say lines and hang up on our side; return the answers until the server hangs up."""
    reader, writer = await asyncio.open_unix_connection(path)
    writer.write(b"".join(line + b"\n" for line in lines))
    writer.write_eof()
    answers = (await reader.read()).splitlines()
    writer.close()
    await writer.wait_closed()
    return answers


def test_each_line_gets_one_answer(tmp_path: Path) -> None:
    async def talk(path: Path) -> None:
        status, refused, again = await say(path, b'{"verb": "status"}', b"nonsense", b'{"verb": "status"}')
        standing = {
            "epoch": 7,
            "seq": 12,
            "safe": None,
            "spare": False,
            "build": "",
            "drained": False,
            "checkpoint": "",
        }
        assert json.loads(status) == {"ok": True, "pid": os.getpid(), **standing}
        assert json.loads(refused) == {"ok": False, "error": "The line is not JSON."}
        assert status == again

    served(tmp_path / "control", talk)


def test_a_line_that_never_ends_ends_the_connection_and_nothing_else(tmp_path: Path) -> None:
    async def talk(path: Path) -> None:
        reader, writer = await asyncio.open_unix_connection(path)
        writer.write(b"x" * (3 * LINE_BYTES_MAX))
        # Hung up on with bytes unread: the kernel says so by a reset.
        with contextlib.suppress(ConnectionResetError):
            assert await reader.read() == b""
        writer.close()
        assert len(await say(path, b'{"verb": "status"}')) == 1

    served(tmp_path / "control", talk)


def test_who_comes_when_all_places_are_taken_is_hung_up_on(tmp_path: Path) -> None:
    async def talk(path: Path) -> None:
        taken = [await asyncio.open_unix_connection(path) for _ in range(CONNECTIONS_MAX)]
        for reader, writer in taken:
            writer.write(b'{"verb": "status"}\n')
            assert await reader.readline()
        reader, writer = await asyncio.open_unix_connection(path)
        assert await reader.read() == b""
        for _, open_writer in [*taken, (reader, writer)]:
            open_writer.close()
            await open_writer.wait_closed()

    served(tmp_path / "control", talk)


def test_who_says_nothing_is_hung_up_on(tmp_path: Path) -> None:
    async def talk(path: Path) -> None:
        reader, writer = await asyncio.open_unix_connection(path)
        assert await reader.read() == b""
        writer.close()
        await writer.wait_closed()

    served(tmp_path / "control", talk, silence_s=0.01)


def test_an_open_connection_does_not_keep_the_core_from_leaving(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as line:
        line.settimeout(30)

        async def talk(path: Path) -> None:
            await asyncio.to_thread(line.connect, str(path))
            await asyncio.to_thread(line.sendall, b'{"verb": "status"}\n')
            assert (await asyncio.to_thread(line.recv, LINE_BYTES_MAX)).endswith(b"\n")

        served(tmp_path / "control", talk)
        assert line.recv(1) == b""


def safe(generation: int, *, on: bool = True) -> bytes:
    order = {"verb": "safe", "on": on, "reason": "DISK_FULL", "generation": generation}
    return json.dumps(order).encode()


def test_an_order_that_can_not_be_carried_out_is_answered_with_the_reason(tmp_path: Path) -> None:
    async def talk(path: Path) -> None:
        drill = b'{"verb": "drill", "fault": "slow-tx", "generation": 4}'
        told = [json.loads(line) for line in await say(path, safe(4), safe(4, on=False), drill)]
        assert [answer["ok"] for answer in told] == [True, False, False]
        assert told[1]["error"] == "It takes no write yet."
        assert told[2]["error"] == "There is no writer."

    served(tmp_path / "control", talk)


def test_every_order_that_changes_something_is_refused_to_an_older_generation(tmp_path: Path) -> None:
    async def talk(path: Path) -> None:
        told = [
            json.loads(line) for line in await say(path, safe(5), safe(4), b'{"verb": "status"}', safe(6))
        ]
        assert [answer["ok"] for answer in told] == [True, False, True, True]
        assert told[1]["error"] == "Generation 4 is over: 5 gives the orders."

    served(tmp_path / "control", talk)


def test_the_tasks_of_the_loop_are_told_with_the_place_where_they_wait(tmp_path: Path) -> None:
    async def wait(transaction_id: str) -> None:  # noqa: ARG001  told from its frame
        await asyncio.get_running_loop().create_future()

    async def talk(path: Path) -> None:
        waiting = asyncio.create_task(wait("tx-1"), name="cmd:tx-1")
        await asyncio.sleep(0)
        (line,) = await say(path, b'{"verb": "tasks"}')
        waiting.cancel()
        told = json.loads(line)
        assert told["ok"]
        assert told["count"] == len(told["tasks"])
        first = told["tasks"][0]
        assert (first["name"], first["transaction_id"], first["account_id"]) == ("cmd:tx-1", "tx-1", "")
        assert first["waits_at"].startswith("core_guarded/test_control.py:")
        assert first["waits_at"].endswith(" wait")

    served(tmp_path / "control", talk)
