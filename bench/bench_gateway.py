"""What the gateway costs: requests per second through it against straight to the same core, in one run.

The core here is the smallest that answers, so the numbers are the gateway's own cost and not a ledger's. Both
ways are measured by the same client, in turn, several rounds; medians are printed with the machine they were
taken on. Run it with `python bench/bench_gateway.py [--rounds 5] [--seconds 2] [--connections 32]`.
"""

import argparse
import asyncio
import json
import os
import platform
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import cast

import httptools
import uvloop

EPOCH = 1
HOUSE = Path(__file__).resolve().parent.parent
ANSWER = (
    b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: 27\r\nX-Core-Epoch: 1\r\n\r\n"
    b'{"posted": "12000", "ok":1}'
)
REQUEST = (
    b"GET /api/ledger/accounts/assets:bank HTTP/1.1\r\nHost: localhost\r\nUser-Agent: bench\r\n"
    b"Accept: application/json\r\nAccept-Language: ko,en;q=0.8\r\n\r\n"
)


class SmallestCore(asyncio.Protocol):
    """Answers every request with the same bytes."""

    def __init__(self) -> None:
        self._parser = httptools.HttpRequestParser(self)
        self._transport: asyncio.WriteTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the transport."""
        self._transport = cast("asyncio.WriteTransport", transport)

    def data_received(self, data: bytes) -> None:
        """Parse."""
        self._parser.feed_data(data)

    def on_message_complete(self) -> None:
        """Answer."""
        assert self._transport is not None
        self._transport.write(ANSWER)


class Loader(asyncio.Protocol):
    """One client: asks, waits for the answer, asks again."""

    def __init__(self) -> None:
        self.latencies: list[float] = []
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
        self._transport.write(REQUEST)

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


async def load(where: Path | int, connections: int, seconds: float) -> tuple[float, float]:
    """Requests per second, and the 99th percentile in milliseconds."""
    loop = asyncio.get_running_loop()
    loaders: list[Loader] = []
    for _ in range(connections):
        if isinstance(where, Path):
            _, loader = await loop.create_unix_connection(Loader, str(where))
        else:
            _, loader = await loop.create_connection(Loader, "127.0.0.1", where)
        loaders.append(loader)
    began = time.perf_counter()
    await asyncio.sleep(seconds)
    took = time.perf_counter() - began
    for loader in loaders:
        loader.stop()
    latencies = sorted(one for loader in loaders for one in loader.latencies)
    return len(latencies) / took, latencies[int(len(latencies) * 0.99)] * 1000


async def feed(control: Path, core: Path) -> tuple[asyncio.Server, asyncio.Event]:
    """The sentinel's side: names the core, and knows when the gateway has served."""
    served = asyncio.Event()
    lines = [
        {"type": "serving", "generation": 1, "socket": str(core), "epoch": EPOCH},
        {"type": "release", "generation": 1, "epoch": EPOCH, "incident": None},
        {"type": "phase", "generation": 1, "phase": "RUNNING", "state": "OPERATIONAL", "face": "FORWARD"},
    ]

    async def greet(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"".join(json.dumps(line).encode() + b"\n" for line in lines))
        async for line in reader:
            if json.loads(line).get("type") == "served":
                served.set()
        writer.close()

    return await asyncio.start_unix_server(greet, str(control)), served


def start(core: Path, control: Path, listener: socket.socket) -> list[subprocess.Popen[bytes]]:
    """The core and the gateway, as processes of their own."""
    fd = listener.fileno()
    gateway = [sys.executable, "-m", "hardcore.crisis", "--listen-fd", str(fd), "--control", str(control)]
    return [
        subprocess.Popen([sys.executable, __file__, "--core", str(core)], cwd=HOUSE),
        subprocess.Popen(gateway, pass_fds=(fd,), stderr=subprocess.DEVNULL, cwd=HOUSE),
    ]


async def measure(folder: Path, options: argparse.Namespace) -> None:
    """Start everything, measure both ways in turn, print."""
    core, control = folder / "core.sock", folder / "control.sock"
    listener = socket.create_server(("127.0.0.1", 0))
    port = listener.getsockname()[1]
    server, served = await feed(control, core)
    children = start(core, control, listener)
    try:
        await asyncio.wait_for(served.wait(), 20)
        straight, through = [], []
        for _ in range(options.rounds):
            straight.append(await load(core, options.connections, options.seconds))
            through.append(await load(port, options.connections, options.seconds))
        report(straight, through, options)
    finally:
        for child in children:
            child.kill()
            child.wait()
        server.close()
        listener.close()


def report(
    straight: list[tuple[float, float]], through: list[tuple[float, float]], options: argparse.Namespace
) -> None:
    """Medians, their ratio, and the machine."""
    print(
        f"{platform.machine()}, {os.cpu_count()} CPUs, Linux {platform.release()}, Python {platform.python_version()}"
    )
    print(f"{options.connections} connections, {options.rounds} rounds of {options.seconds:g} s, medians:")
    rates = {}
    for name, rounds in {"straight to the core": straight, "through the gateway": through}.items():
        rates[name] = statistics.median(rate for rate, _ in rounds)
        late = statistics.median(p99 for _, p99 in rounds)
        print(f"  {name:22} {rates[name]:9,.0f} requests/s   p99 {late:6.1f} ms")
    ratio = rates["through the gateway"] / rates["straight to the core"]
    print(f"  ratio                  {ratio:9.2f}")


async def be_the_core(path: str) -> None:
    """Serve until killed."""
    server = await asyncio.get_running_loop().create_unix_server(SmallestCore, path)
    await server.serve_forever()


def main() -> None:
    """Measure, or be the core that is measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--core", help=argparse.SUPPRESS)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--connections", type=int, default=32)
    options = parser.parse_args()
    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        if options.core:
            runner.run(be_the_core(options.core))
            return
        with tempfile.TemporaryDirectory() as folder:
            runner.run(measure(Path(folder), options))


if __name__ == "__main__":
    main()
