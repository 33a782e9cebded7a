"""What is asked of a core over its sockets comes back in its time, or is no answer."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path

import pytest

from hardcore.host import core_control, probe
from tests.waiting import WAIT_S

Answer = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]
WELL = b'HTTP/1.1 200 OK\r\ncontent-type: application/json\r\n\r\n{"epoch": 3, "seq": 41}'


def saying(answer: bytes) -> Answer:
    async def say(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readline()
        writer.write(answer)
        writer.close()

    return say


async def silent(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    await reader.read()
    writer.close()


async def asked_of(place: Path, answer: Answer, ask: Callable[[], Awaitable[object]]) -> object:
    done = asyncio.Semaphore(0)
    asked = 0

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        nonlocal asked
        asked += 1
        await answer(reader, writer)
        with suppress(OSError):  # who asked may be gone before all was said
            await writer.wait_closed()
        done.release()

    server = await asyncio.start_unix_server(serve, str(place))
    async with server:
        came = await ask()
        for _ in range(asked):
            await done.acquire()
        return came


@pytest.mark.parametrize(
    ("answer", "health"),
    [
        (saying(WELL), probe.Health(3, 41)),
        (saying(b"HTTP/1.1 200 OK\r\n\r\n"), probe.Health(None, None)),
        (saying(b"HTTP/1.1 200 OK\r\n\r\n[1]"), probe.Health(None, None)),
        (saying(b'HTTP/1.1 200 OK\r\n\r\n{"epoch": "3", "seq": true}'), probe.Health(None, None)),
        (saying(b"HTTP/1.1 503 Gone\r\n\r\n" + b"x" * 100_000), None),
        (saying(b"what"), None),
        (saying(b""), None),
    ],
)
def test_only_a_200_is_health_whatever_stands_in_it(
    tmp_path: Path, answer: Answer, health: probe.Health | None
) -> None:
    place = tmp_path / "core.sock"
    assert asyncio.run(asked_of(place, answer, lambda: probe.ask_health(place, WAIT_S))) == health


def test_a_core_that_says_nothing_has_not_answered_when_the_time_is_over(tmp_path: Path) -> None:
    place = tmp_path / "core.sock"
    assert asyncio.run(asked_of(place, silent, lambda: probe.ask_health(place, 0.05))) is None


def test_a_core_that_does_not_listen_has_not_answered(tmp_path: Path) -> None:
    assert asyncio.run(probe.ask_health(tmp_path / "nobody", WAIT_S)) is None


@pytest.mark.parametrize(
    ("answer", "refused"),
    [
        (b'{"ok": true}\n', ""),
        (b'{"ok": false, "error": "the store takes no write"}\n', "the store takes no write"),
        (b'{"ok": false}\n', "it gave no reason"),
        (b'{"ok": 1}\n', "it gave no reason"),
        (b"[]\n", "the core hung up"),
        (b"", "the core hung up"),
        (b"no json\n", "the core's control socket does not answer (JSONDecodeError)"),
        (b"x" * 10_000 + b"\n", "the core's control socket does not answer (ValueError)"),
        (json.dumps({"ok": False, "error": "e" * 1000}).encode() + b"\n", "e" * core_control.WORDS_MAX),
    ],
)
def test_an_order_is_done_only_if_the_core_says_so(tmp_path: Path, answer: bytes, refused: str) -> None:
    place = tmp_path / "core.ctl"

    def give() -> Awaitable[object]:
        return core_control.give(place, {"verb": "safe"}, WAIT_S)

    assert asyncio.run(asked_of(place, saying(answer), give)) == refused


def test_an_order_to_a_core_that_is_stuck_or_gone_is_not_done(tmp_path: Path) -> None:
    place = tmp_path / "core.ctl"
    late = asyncio.run(asked_of(place, silent, lambda: core_control.give(place, {}, 0.05)))
    assert late == "the core did not answer within 0.05 s"
    gone = asyncio.run(core_control.give(tmp_path / "nobody", {}, WAIT_S))
    assert gone == "the core's control socket does not answer (FileNotFoundError)"
