"""The gateway process: takes the inherited listener, follows the feed, serves until it is told to leave.

Started by the sentinel with an open listening socket, so that nothing here can fail for a port, and a new
gateway goes on where a dead one stopped. SIGTERM drains: no new connections, whoever waits is answered,
what is at the core may finish; INT and HUP are meant for the people at the terminal, not for us.
"""

import argparse
import asyncio
import faulthandler
import gc
import logging
import os
import resource
import signal
import socket
import time
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import uvloop

from hardcore.access.doorway import Doorway, Names
from hardcore.access.files import read_doorway
from hardcore.crisis import agent, log_lines
from hardcore.crisis.burden import Burden
from hardcore.crisis.census import Census
from hardcore.crisis.client import ClientConnection
from hardcore.crisis.desk import Desk
from hardcore.crisis.drills import DrillDoor
from hardcore.crisis.encryption import certificate
from hardcore.crisis.feed import stats_line
from hardcore.crisis.gate import Gate
from hardcore.crisis.history import History
from hardcore.crisis.limits import GatewayLimits, limits_from
from hardcore.crisis.link import FeedLink
from hardcore.crisis.mishap import describe
from hardcore.crisis.recording import NOBODYS, Recording, record_on
from hardcore.crisis.shelf import Shelf, stock

_LOG = logging.getLogger(__name__)

#: Names of this machine for itself.
LOOPBACK_NAMES = ("localhost", "127.0.0.1", "[::1]")
#: Connections that may wait to be accepted.
BACKLOG = 512

#: Descriptors for `connections_max` clients and the core's side, with room to spare.
FILES_WANTED = 16_384

#: New objects until circles are looked for. A request leaves none behind, so looking often only costs.
GARBAGE_EVERY = 50_000

#: That nothing has changed is news as well: who waits for a quiet moment believes no old number.
STATS_AGAIN_S = 1.0

EXIT_FINE = 0
EXIT_CONFIG = 78


class Gateway:
    """Everything of one gateway process, from the listener to the last answer."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        listener: socket.socket,
        control: str,
        hosts: Sequence[str],
        limits: GatewayLimits,
        *,
        demo: bool,
        recoveries: Path | None = None,
        receipts: Path | None = None,
        state: Path | None = None,
        investigator: Path | None = None,
        own_door: Path | None = None,
        recording: Recording = NOBODYS,
    ) -> None:
        self._loop = loop
        self._recording = recording
        self._demo = demo
        self._listener = listener
        self._limits = limits
        self._leaving = asyncio.Event()
        self._all_gone = asyncio.Event()
        self._stats: tuple[int, int, int, int] | None = None
        doorway = read_doorway(state) if state is not None else Doorway()
        given = (*LOOPBACK_NAMES, *_address(listener), *hosts, *doorway.names)
        names = Names(given, addresses=doorway.open)
        self._tls = certificate(doorway)
        self._own_door = own_door
        self._census = Census(
            names, time.monotonic_ns, self._connections_changed, Burden(limits.answers_bytes_max)
        )
        self._link = FeedLink(loop, control, os.getpid(), limits)
        drills = DrillDoor(loop, control) if demo else None
        self._history = History(loop, recoveries)
        gate = Gate(loop, limits, state, time.monotonic_ns, doorway)
        self._desk = Desk(
            loop,
            limits,
            self._link,
            time.monotonic_ns,
            drills,
            self._history,
            receipts,
            state,
            investigator,
            gate,
        )
        self._desk.connections = lambda: len(self._census.connections)

    async def serve(self) -> None:
        """Serve until SIGTERM, then drain."""
        self._recording.begin(self._loop)
        self._loop.add_signal_handler(signal.SIGTERM, self._leaving.set)
        server = await self._loop.create_server(
            lambda: ClientConnection(self._loop, self._desk, self._census, self._recording),
            sock=self._listener,
            backlog=BACKLOG,
            **self._encryption(),
        )
        own = await self._open_own_door()
        self._desk.promises.start()
        self._desk.moves.dock.cases.start()
        self._link.start(self._desk.heard)
        stocking = self._loop.create_task(self._stock())
        upkeep = self._loop.create_task(self._upkeep())
        await self._leaving.wait()
        stocking.cancel()
        server.close()
        if own is not None:
            own.close()
        await self._drain()
        upkeep.cancel()
        self._desk.live.close()
        self._desk.admin.close()
        self._link.close()
        await self._desk.gate.finish()
        await self._desk.promises.finish()
        await self._desk.moves.dock.cases.finish()
        await self._desk.moves.barrier.finish()
        await self._history.finish()

    def _encryption(self) -> dict[str, Any]:
        if self._tls is None:
            return {}
        return {
            "ssl": self._tls.context,
            "ssl_handshake_timeout": self._limits.tls_handshake_ms / 1000,
            "ssl_shutdown_timeout": self._limits.linger_ms / 1000,
        }

    async def _open_own_door(self) -> asyncio.Server | None:
        """Listen for the owner's own programs, on a socket that nobody else may open."""
        if self._own_door is None:
            return None
        made = self._own_door.with_name(f"{self._own_door.name}.{os.getpid()}")
        listener = socket.socket(socket.AF_UNIX)
        try:
            made.unlink(missing_ok=True)
            listener.bind(str(made))
            made.chmod(0o600)
            made.replace(self._own_door)  # the one of the gateway before leads to nobody any more
        except OSError as error:
            listener.close()
            _LOG.error("the owner's own door can't be opened: %s", error)
            return None
        return await self._loop.create_unix_server(
            lambda: ClientConnection(self._loop, self._desk, self._census, self._recording),
            sock=listener,
            backlog=BACKLOG,
        )

    async def _stock(self) -> None:
        """Render the gateway's own pages and files: once the first requests are served, or if one asks for a file.

        Before its hold is over nobody needs a page of ours, and rendering takes the interpreter from who is served.
        """
        with suppress(TimeoutError):
            await asyncio.wait_for(self._desk.counter.wanted.wait(), self._limits.paper_after_ms / 1000)
        shelf = Shelf()
        try:
            shelf = await self._loop.run_in_executor(None, partial(stock, demo=self._demo))
        except Exception as error:  # noqa: BLE001 - whatever is wrong with the paper: requests are answered
            _LOG.error("the recovery pages could not be made, plain ones are shown: %s", describe(error))
        finally:
            self._desk.counter.stocked(shelf)

    async def _drain(self) -> None:
        _LOG.info("leaving: %d connections", len(self._census.connections))
        self._desk.moves.leave()
        self._desk.admin.leave()
        self._desk.sockets.leaving = True
        for connection in list(self._census.connections):
            connection.depart()
        await self._wait_until_gone(self._limits.drain_ms)
        self._desk.moves.give_up()
        for connection in list(self._census.connections):
            connection.depart()
        await self._wait_until_gone(self._limits.flush_ms)

    async def _wait_until_gone(self, wait_ms: int) -> None:
        if not self._census.connections:
            return
        self._all_gone.clear()
        try:
            await asyncio.wait_for(self._all_gone.wait(), wait_ms / 1000)
        except TimeoutError:
            _LOG.info("%d connections are still open", len(self._census.connections))

    def _connections_changed(self) -> None:
        if not self._census.connections:
            self._all_gone.set()

    async def _upkeep(self) -> None:
        """Tell numbers when they change and as often as they are believed, and look after connections to the core."""
        loop, said_s = asyncio.get_running_loop(), 0.0
        while True:
            await asyncio.sleep(self._limits.stats_ms / 1000)
            self._desk.upkeep()
            if self._tls is not None:
                self._tls.upkeep()
            held, forwarded = self._desk.moves.counts()
            now = (held, len(self._census.connections), len(self._desk.sockets), forwarded)
            if now != self._stats or loop.time() - said_s >= STATS_AGAIN_S:
                said_s = loop.time()
                line = stats_line(held=held, connections=now[1], websockets=now[2], forwarded=forwarded)
                self._stats = now if self._link.say(line) else None


def _address(listener: socket.socket) -> tuple[str, ...]:
    """Return the address that we listen on as a URL names it: whoever reached us by it may say so."""
    if listener.family == socket.AF_INET6:
        return (f"[{listener.getsockname()[0]}]",)
    return (listener.getsockname()[0],) if listener.family == socket.AF_INET else ()


def _options(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m hardcore.crisis", description="The gateway.")
    parser.add_argument("--listen-fd", type=int, required=True, help="the listening TCP socket, inherited")
    parser.add_argument("--control", required=True, help="the sentinel's control socket")
    parser.add_argument(
        "--allow-host", action="append", default=[], help="another name this server answers to"
    )
    parser.add_argument("--recoveries", type=Path, help="where outages that are over are remembered")
    parser.add_argument("--receipts", type=Path, help="where promised requests are kept")
    parser.add_argument("--state", type=Path, help="where rules of the quarantine and cases of suspects lie")
    parser.add_argument("--investigator", type=Path, help="where the investigators listen")
    parser.add_argument(
        "--own-door", type=Path, help="where the owner's own programs ask, without a password"
    )
    parser.add_argument("--page", type=Path, help="the page on which the guard looks for our beats")
    parser.add_argument("--agents", type=Path, help="what the sentinel has left word of for its agents")
    parser.add_argument("--demo", action="store_true", help="let pages of this address break the core")
    return parser.parse_args(arguments)


def _allow_files() -> None:
    """Use as many descriptors as we may: the usual soft limit is below the connections we take."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = FILES_WANTED if hard == resource.RLIM_INFINITY else min(FILES_WANTED, hard)
    resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def main(arguments: Sequence[str]) -> int:
    """Run the gateway; returns the exit code."""
    faulthandler.enable()
    _allow_files()
    for deaf in (signal.SIGINT, signal.SIGHUP):
        signal.signal(deaf, signal.SIG_IGN)
    log_lines.begin()
    options = _options(arguments)
    limits = limits_from(os.environ.get("HARDCORE_LIMITS", ""))
    if isinstance(limits, list):
        for fault in limits:
            _LOG.error("%s %s", fault.name, fault.reason)
        return EXIT_CONFIG
    try:
        listener = socket.socket(fileno=options.listen_fd)
    except OSError as error:
        _LOG.error("--listen-fd %d is no socket: %s", options.listen_fd, error.strerror)
        return EXIT_CONFIG

    refused = options.state / "refused_paths.json" if options.state is not None else None
    try:
        recording = record_on(options.page, refused)
    except OSError as error:  # it serves all the same: the guard then knows of it what the kernel says
        _LOG.error("the page %s can't be written: %s", options.page, error)
        recording = NOBODYS

    agent.begin_if_told(options.agents, options.listen_fd)
    gc.freeze()  # what was loaded stays
    gc.set_threshold(GARBAGE_EVERY)

    async def run() -> None:
        loop = asyncio.get_running_loop()
        gateway = Gateway(
            loop,
            listener,
            options.control,
            options.allow_host,
            limits,
            demo=options.demo,
            recoveries=options.recoveries,
            receipts=options.receipts,
            state=options.state,
            investigator=options.investigator,
            own_door=options.own_door,
            recording=recording,
        )
        await gateway.serve()

    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        runner.run(run())
    return EXIT_FINE
