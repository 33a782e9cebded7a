"""A thousand open tabs over a death: how soon the last of them knows, and what each costs the gateway.

Half of them are the pages' own sockets, half lead to the core; all are told in-band that the core is gone. The core
is killed from outside; the time runs from the blow until the last tab has read its frame, in one client process that
reads all of them, so the client's own work is in the number.
"""

import asyncio
import base64
import os
import signal
import time
from pathlib import Path
from typing import cast

import psutil
import uvloop

from bench.figures import Figure, Target
from bench.instance import Watched, fill

PLACES = {"/__hc/live": "", "/ws": "Sec-WebSocket-Protocol: hardcore.v1\r\n"}
TOLD_MS = Target(200)
WAIT_S = 30.0
#: Tabs that ask for their socket at a time: people do not open a thousand in one moment.
OPENING = 50
_NEWS = b'"text":"R1"'


class Tab(asyncio.Protocol):
    """One open tab."""

    def __init__(self, path: str, more: str) -> None:
        loop = asyncio.get_running_loop()
        self.open: asyncio.Future[None] = loop.create_future()
        self.told: asyncio.Future[int] = loop.create_future()
        self._ask = (
            f"GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
            f"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {base64.b64encode(os.urandom(16)).decode()}\r\n{more}\r\n"
        ).encode()
        self._transport: asyncio.WriteTransport | None = None
        self._heard = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Ask."""
        self._transport = cast("asyncio.WriteTransport", transport)
        self._transport.write(self._ask)

    def data_received(self, data: bytes) -> None:
        """Look for the news; what is split between two reads is put together."""
        self._heard += data
        if not self.open.done() and b"\r\n\r\n" in self._heard:
            assert self._heard.startswith(b"HTTP/1.1 101"), self._heard[:200]
            self.open.set_result(None)
        if not self.told.done() and _NEWS in self._heard:
            self.told.set_result(time.monotonic_ns())
        self._heard = self._heard[-len(_NEWS) :] if self.open.done() else self._heard

    def connection_lost(self, exc: Exception | None) -> None:
        """A tab that loses its socket would have to say that the network is gone."""
        lost = ConnectionError(f"a tab lost its socket: {exc}")
        for waiting in (self.open, self.told):
            if not waiting.done():
                waiting.set_exception(lost)

    def leave(self) -> None:
        """Close without a word."""
        self.told.cancel()
        if self._transport is not None:
            self._transport.abort()


def measure(folder: Path, *, tabs: int, kills: int) -> list[Figure]:
    """Kill the core under open tabs, so many times."""
    with Watched(folder / "tabs") as instance:
        fill(instance, 0)
        gateway = psutil.Process(instance.status()["gateway"]["pid"])
        instance.quiet()
        before = gateway.memory_info().rss
        with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
            told, each = [], []
            for _ in range(kills):
                took_ms, rss = runner.run(_round(instance, gateway, tabs))
                told.append(took_ms)
                each.append((rss - before) / tabs / 1024)
                instance.quiet()
    return [
        Figure(f"{tabs:,} open tabs, until the last knows", "ms", tuple(told), target=TOLD_MS),
        Figure("an open tab in the gateway", "KiB", tuple(each[:1])),
    ]


async def _round(instance: Watched, gateway: psutil.Process, count: int) -> tuple[float, int]:
    loop = asyncio.get_running_loop()
    host, port = instance.address
    tabs: list[Tab] = []
    kinds = list(PLACES.items())
    try:
        while len(tabs) < count:
            begun = []
            for number in range(min(OPENING, count - len(tabs))):
                path, more = kinds[number % len(kinds)]
                _, tab = await loop.create_connection(lambda p=path, m=more: Tab(p, m), host, port)  # type: ignore[misc]
                begun.append(tab)
            tabs += begun
            await asyncio.wait_for(asyncio.gather(*(tab.open for tab in begun)), WAIT_S)
        rss = int(gateway.memory_info().rss)
        core = instance.core()
        blow_ns = core.hit(signal.SIGKILL)
        core.let_go()
        told = await asyncio.wait_for(asyncio.gather(*(tab.told for tab in tabs)), WAIT_S)
        return (max(told) - blow_ns) / 1e6, rss
    finally:
        for tab in tabs:
            tab.leave()
