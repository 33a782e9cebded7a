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
from hypothesis import given
from hypothesis import strategies as st

from core.guarded.control import (
    CONNECTIONS_MAX,
    LINE_BYTES_MAX,
    ControlServer,
    ControlUnboundError,
    DrillOrder,
    Refused,
    Standing,
    StatusOrder,
    bind_private,
    read_order,
)
from core.guarded.drills import Drill


def drill(fault: object = "crash", generation: object = 4) -> bytes:
    return json.dumps({"verb": "drill", "fault": fault, "generation": generation}).encode()


def test_orders_are_read() -> None:
    assert read_order(b'{"verb": "status"}', 9) == StatusOrder()
    for fault in Drill:
        assert read_order(drill(fault.value), 4) == DrillOrder(fault, 4)


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"status",
        b"[]",
        b'"status"',
        b"{}",
        b'{"verb": "shutdown"}',
        b'{"verb": ["status"]}',
        b"[" * 3000,
        b"\xff",
        drill("melt"),
        drill(None),
        drill(["crash"]),
        drill(generation=None),
        drill(generation="4"),
        drill(generation=True),
        drill(generation=-1),
        drill(generation=3),
    ],
)
def test_what_is_no_order_is_refused_with_a_sentence(line: bytes) -> None:
    refused = read_order(line, 4)
    assert isinstance(refused, Refused)
    assert refused.error.endswith(".")


@given(st.binary(max_size=200))
def test_no_line_can_raise(line: bytes) -> None:
    assert isinstance(read_order(line, 0), StatusOrder | Refused | DrillOrder)


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
    server = ControlServer(tmp_path / "control", lambda: Standing(7, 12), lambda _code, _text: None)
    with pytest.raises(ControlUnboundError, match="in use"):
        asyncio.run(server.open())


def served(path: Path, talk: Callable[[Path], Awaitable[None]], silence_s: float = 10.0) -> None:
    """Run `talk` against a server on `path`; afterwards the socket is gone."""

    async def run() -> None:
        server = ControlServer(path, lambda: Standing(7, 12), lambda _code, _text: None, silence_s)
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
        assert json.loads(status) == {"ok": True, "pid": os.getpid(), "epoch": 7, "seq": 12}
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
