"""Clients that ask, wait for the answer and ask again, all in one thread: what they are answered, and how soon.

The same client for every way to a core, so that its own cost is in each of the numbers alike.
"""

import asyncio
import time
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import httptools

#: So long may a first answer take.
ANSWER_S = 20.0


@dataclass(frozen=True, slots=True)
class Load:
    """What came of it. `median_ms` and `late_ms` (the 99th percentile) are of one request."""

    per_second: float
    median_ms: float
    late_ms: float


def request(path: str) -> bytes:
    """A GET as a page's script sends it."""
    return (
        f"GET {path} HTTP/1.1\r\nHost: localhost\r\nUser-Agent: bench\r\n"
        "Accept: application/json\r\nAccept-Language: ko,en;q=0.8\r\n\r\n"
    ).encode()


class Loader(asyncio.Protocol):
    """One client."""

    def __init__(self, asks: bytes) -> None:
        self.latencies: list[float] = []
        self._asks = asks
        self._parser = httptools.HttpResponseParser(self)
        self._transport: asyncio.WriteTransport | None = None
        self._asked = 0.0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Ask for the first time."""
        self._transport = cast("asyncio.WriteTransport", transport)
        self._ask()

    def _ask(self) -> None:
        assert self._transport is not None
        self._asked = time.perf_counter()
        self._transport.write(self._asks)

    def data_received(self, data: bytes) -> None:
        """Parse."""
        self._parser.feed_data(data)

    def on_message_complete(self) -> None:
        """Count, and ask again."""
        assert self._parser.get_status_code() == 200
        self.latencies.append(time.perf_counter() - self._asked)
        self._ask()

    def stop(self) -> None:
        """Ask no more."""
        assert self._transport is not None
        self._transport.abort()


async def load(where: Path | int, asks: bytes, connections: int, seconds: float) -> Load:
    """Ask at a socket or a port of this machine, over so many connections, for so long."""
    loop = asyncio.get_running_loop()
    loaders: list[Loader] = []
    for _ in range(connections):
        if isinstance(where, Path):
            _, loader = await loop.create_unix_connection(lambda: Loader(asks), str(where))
        else:
            _, loader = await loop.create_connection(lambda: Loader(asks), "127.0.0.1", where)
        loaders.append(loader)
    began = time.perf_counter()
    await asyncio.sleep(seconds)
    took = time.perf_counter() - began
    for loader in loaders:
        loader.stop()
    latencies = sorted(one for loader in loaders for one in loader.latencies)
    assert latencies, "nobody was answered"
    middle, late = latencies[len(latencies) // 2], latencies[int(len(latencies) * 0.99)]
    return Load(len(latencies) / took, middle * 1000, late * 1000)
