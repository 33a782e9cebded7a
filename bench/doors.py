"""How soon a monitor is answered at the doors while everything else goes wrong.

Every door is asked by a client that dials anew each time, as a probe does, beside a flood, beside a thousand clients that
never finish a sentence, with every place taken, and over a dead core. What is judged is the longest wait of all, because
a probe that is late once restarts a machine. The floods are made by processes of their own, and the machine has no more
processors for that: its load is in the numbers.
"""

import asyncio
import re
import resource
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, AsyncExitStack, contextmanager
from pathlib import Path

from bench import ways
from bench.figures import Figure, Target
from examples.guarded import GuardError

DOORS = ("/livez", "/readyz", "/startupz", "/health", "/metrics")
LONGEST_MS = Target(100)
FLOODERS = 64
#: More than one address may have: whoever comes then finds no place.
PLACES = 1536
#: Longer than a part takes, so that nobody who floods is sent away meanwhile.
STAYS_MS = 120_000
ANSWER_S = 20.0
#: Between two questions, so that the whole lasts longer than a fit of the flood.
ASK_EVERY_S = 0.003
LOOK_EVERY_S = 0.05
NS_PER_MS = 1e6
_OPEN = re.compile(rb"^hardcore_gateway_connections (\d+)$", re.MULTILINE)


def measure(folder: Path, *, asks: int, half_open: int) -> list[Figure]:
    """Ask every door so many times beside each thing that may be wrong."""
    _allow_files()
    return asyncio.run(_measure(folder, asks, half_open))


async def _measure(folder: Path, asks: int, half_open: int) -> list[Figure]:
    figures: list[Figure] = []

    async def ask_all(words: str, port: int) -> None:
        figures.extend(await asyncio.to_thread(_asked, words, port, asks))

    async with _Served(folder) as (port, _kill):
        await ask_all("in peace", port)
        with _flood(port):
            await ask_all(f"{FLOODERS} clients ask all the time", port)
    async with _Served(folder, header_timeout_ms=STAYS_MS) as (port, _kill):
        with _half_open(port, half_open):
            await ask_all(f"{half_open:,} clients say half a sentence", port)
        with _half_open(port, PLACES):
            await ask_all("every place is taken", port)
    # A held request is answered soon here: its client then asks the next one, which is what makes it a flood.
    async with _Served(folder, hold_ms=20) as (port, kill):
        kill.close()
        with _flood(port):
            await ask_all(f"the core is dead, {FLOODERS} clients ask", port)
    return figures


class _Served:
    """A gateway before the smallest core; its port, and what ends the core."""

    def __init__(self, folder: Path, **limits: int) -> None:
        self._folder, self._limits = folder, limits
        self._stack = AsyncExitStack()

    async def __aenter__(self) -> tuple[int, "_Core"]:
        core = _Core(ways.smallest(self._folder))
        self._stack.callback(core.close)
        path, epoch, _asked = core.place
        port = await self._stack.enter_async_context(ways.gateway(self._folder, path, epoch, **self._limits))
        return port, core

    async def __aexit__(self, *_: object) -> None:
        await self._stack.aclose()


class _Core:
    """A core that can be ended before its time."""

    def __init__(self, core: AbstractContextManager[tuple[Path, int, str]]) -> None:
        self._core: AbstractContextManager[tuple[Path, int, str]] | None = core
        self.place = core.__enter__()

    def close(self) -> None:
        """End it, once."""
        core, self._core = self._core, None
        if core is not None:
            core.__exit__(None, None, None)


def _asked(words: str, port: int, asks: int) -> list[Figure]:
    """Ask each door in turn; return the longest of all waits and how many were not answered by the door."""
    waits, strange = [], 0
    for number in range(asks * len(DOORS)):
        door = DOORS[number % len(DOORS)]
        began_ns = time.monotonic_ns()
        strange += not _is_answered(port, door)
        waits.append((time.monotonic_ns() - began_ns) / NS_PER_MS)
        time.sleep(ASK_EVERY_S)
    longest = [max(waits[start :: len(DOORS)]) for start in range(len(DOORS))]
    return [
        Figure(f"longest of {asks}, {words}", "ms", (max(longest),), target=LONGEST_MS),
        Figure("  the usual", "ms", (sorted(waits)[len(waits) // 2],)),
        Figure("  not answered by the door", "", (strange,), target=Target(0)),
    ]


def _is_answered(port: int, door: str) -> bool:
    """Whether the door itself answered: what it says is not the question here, and no door says that it is busy."""
    said = _ask(port, door)
    return said.startswith((b"HTTP/1.1 200", b"HTTP/1.1 503")) and b"too-busy" not in said


def _ask(port: int, door: str) -> bytes:
    head = f"GET {door} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
    said = bytearray()
    with socket.create_connection(("127.0.0.1", port), ANSWER_S) as plug:
        plug.sendall(head.encode())
        while came := plug.recv(1 << 16):
            said += came
    return bytes(said)


@contextmanager
def _flood(port: int) -> Iterator[None]:
    address, seconds = f"127.0.0.1:{port}", str(STAYS_MS // 1000)
    argv = [sys.executable, "-m", "bench.pusher", "read", address, str(FLOODERS), seconds, "flood"]
    with ways.process(argv, stdout=subprocess.DEVNULL):
        _until_there(port, FLOODERS)
        yield


def _until_there(port: int, clients: int) -> None:
    """Wait until the gateway has so many clients."""
    give_up_at = time.monotonic() + ANSWER_S
    while (found := _OPEN.search(_ask(port, "/metrics"))) is None or int(found[1]) < clients:
        if time.monotonic() > give_up_at:
            raise GuardError(f"There are not {clients} clients after {ANSWER_S:g} s.")
        time.sleep(LOOK_EVERY_S)


@contextmanager
def _half_open(port: int, clients: int) -> Iterator[None]:
    """So many clients who begin to ask and never end."""
    plugs: list[socket.socket] = []
    try:
        for _ in range(clients):
            plugs.append(socket.create_connection(("127.0.0.1", port), ANSWER_S))
            plugs[-1].sendall(b"GET /api/ledger HTTP/1.1\r\nHost: loc")
        _until_there(port, clients)
        yield
    finally:
        for plug in plugs:
            plug.close()


def _allow_files() -> None:
    _soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
