"""Both ends of the control socket: a question gets one answer, whatever is sent, and nobody's slowness hurts others."""

import asyncio
import contextlib
import json
import os
import socket
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from hardcore.control import client, server
from hardcore.control.protocol import DRILLS, Ask, BadRequest, Request, read_request, write_line
from hardcore.control.server import ControlServer
from tests.waiting import until


@dataclass
class Door:
    """A control server on a thread of its own, with answers a test can foretell."""

    path: Path
    loop: asyncio.AbstractEventLoop = field(default_factory=asyncio.new_event_loop)
    heard: list[dict[str, object]] = field(default_factory=list)
    fds: list[int] = field(default_factory=list)
    server: ControlServer | None = None

    async def answer(self, request: Request) -> tuple[Mapping[str, object], list[int]]:
        return {"ok": True, "ask": request.ask, "reason": request.reason}, self.fds

    def greet(self) -> list[Mapping[str, object]]:
        return [{"type": "phase", "generation": 1}]

    async def open(self) -> None:
        self.server = ControlServer(self.path, self.answer, self.heard.append, self.greet)
        await self.server.start()

    async def close(self) -> None:
        assert self.server is not None
        self.server.close()
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    def publish(self, line: Mapping[str, object]) -> None:
        assert self.server is not None
        self.loop.call_soon_threadsafe(self.server.publish, line)


@pytest.fixture
def door(tmp_path: Path) -> Iterator[Door]:
    made = Door(tmp_path / "control.sock")
    thread = threading.Thread(target=made.loop.run_forever)
    thread.start()
    asyncio.run_coroutine_threadsafe(made.open(), made.loop).result(10)
    yield made
    asyncio.run_coroutine_threadsafe(made.close(), made.loop).result(10)
    made.loop.call_soon_threadsafe(made.loop.stop)
    thread.join(10)
    made.loop.close()
    assert not made.path.exists()


@contextlib.contextmanager
def talk(door: Door) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(10)
        connection.connect(str(door.path))
        yield connection


def test_a_question_gets_its_answer(door: Door) -> None:
    told = client.ask(door.path, {"verb": "restart", "reason": "새 버전"})
    assert told == {"ok": True, "ask": "restart", "reason": "새 버전"}


def test_descriptors_come_along_and_are_the_callers(door: Door) -> None:
    read, write = os.pipe()
    door.fds.append(write)
    told, fds = client.ask_with_fds(door.path, {"verb": "attach"})
    assert told["ok"]
    os.write(fds[0], b"through")
    assert os.read(read, 7) == b"through"
    for fd in (*fds, read, write):
        os.close(fd)


@pytest.mark.parametrize(
    "line",
    [b"\n", b"{\n", b"[]\n", b"\xff\xfe\n", b"[" * 9000 + b"\n", b'{"verb": "fly"}\n', b'{"verb": null}\n'],
)
def test_a_line_that_makes_no_sense_is_answered_with_a_code(door: Door, line: bytes) -> None:
    with talk(door) as connection:
        connection.sendall(line)
        told = json.loads(connection.makefile("rb").readline())
    assert told["ok"] is False
    assert told["code"]
    assert told["error"]


def test_a_line_without_an_end_is_cut_off_and_the_next_is_served(door: Door) -> None:
    with talk(door) as connection:
        with contextlib.suppress(OSError):
            connection.sendall(b"x" * (4 << 20))
        with contextlib.suppress(OSError):
            assert connection.recv(1) == b""
    assert client.ask(door.path, {"verb": "status"})["ok"]


def test_a_client_that_goes_at_once_harms_nobody(door: Door) -> None:
    for _ in range(20):
        with talk(door) as connection:
            connection.sendall(b'{"verb": "sta')
    assert client.ask(door.path, {"verb": "status"})["ok"]


def test_a_subscriber_is_greeted_fed_and_heard(door: Door) -> None:
    with talk(door) as connection:
        connection.sendall(write_line({"verb": "subscribe", "who": "gateway", "pid": 1}))
        lines = connection.makefile("rb")
        assert json.loads(lines.readline()) == {"type": "phase", "generation": 1}
        door.publish({"type": "release", "generation": 2})
        assert json.loads(lines.readline()) == {"type": "release", "generation": 2}
        connection.sendall(b'nonsense\n{"type": "served", "epoch": 3}\n')
        until(lambda: door.heard, "the line to be heard")
    assert door.heard == [{"type": "served", "epoch": 3}]


def test_a_subscriber_that_never_reads_is_cut_off_and_not_waited_for(door: Door) -> None:
    with talk(door) as deaf, talk(door) as other:
        for connection in (deaf, other):
            connection.sendall(write_line({"verb": "subscribe"}))
        lines = other.makefile("rb")
        assert lines.readline()
        big = {"type": "phase", "text": "x" * (64 << 10)}
        for _ in range(2 * server.BACKLOG_BYTES_MAX // (64 << 10)):
            door.publish(big)
            assert len(lines.readline()) > 64 << 10
        with contextlib.suppress(ConnectionResetError):
            while deaf.recv(1 << 20):
                pass


def test_more_subscribers_than_there_is_room_for_are_told_so(door: Door) -> None:
    with contextlib.ExitStack() as stack:
        for _ in range(server.SUBSCRIBERS_MAX):
            connection = stack.enter_context(talk(door))
            connection.sendall(write_line({"verb": "subscribe"}))
            assert connection.recv(4096)
        late = stack.enter_context(talk(door))
        late.sendall(write_line({"verb": "subscribe"}))
        assert json.loads(late.makefile("rb").readline())["code"] == "full"


def test_nobody_there_is_unreachable(tmp_path: Path) -> None:
    with pytest.raises(client.Unreachable):
        client.ask(tmp_path / "nobody.sock", {"verb": "status"})


@pytest.mark.parametrize("said", [b"", b"not json\n", b"[1]\n"])
def test_an_answer_that_is_none_is_unreachable(tmp_path: Path, said: bytes) -> None:
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "odd.sock"))
        listener.listen()

        def once() -> None:
            connection, _ = listener.accept()
            with connection:
                connection.recv(4096)
                connection.sendall(said)

        odd = threading.Thread(target=once)
        odd.start()
        with pytest.raises(client.Unreachable):
            client.ask(tmp_path / "odd.sock", {"verb": "status"})
        odd.join(10)


def test_a_request_is_read_with_its_fields_bounded_and_typed() -> None:
    read = read_request(write_line({"verb": "drill", "fault": DRILLS[0], "yes": True, "reason": "x" * 9999}))
    assert isinstance(read, Request)
    assert (read.ask, read.fault, read.yes, len(read.reason)) == (Ask.DRILL, DRILLS[0], True, 500)
    assert isinstance(read_request(b'{"verb": "drill", "fault": "plague"}'), BadRequest)
    assert isinstance(read_request(b'{"verb": "drill", "fault": "leak", "mb_per_s": -1}'), BadRequest)
    assert isinstance(read_request(b'{"verb": "restart", "reason": 5}'), BadRequest)
    odd = read_request(b'{"verb": "restart", "hard": "yes", "more": [1]}')
    assert isinstance(odd, Request)
    assert odd.hard is False
