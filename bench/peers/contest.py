"""One contest: a peer (or this guard) in front of the guest, hit again and again while a client asks.

Everybody is treated alike: started on the same book, given time to come to rest, killed with SIGKILL at the process that
said it answered, or hung by putting its event loop to sleep. What counts is what the client saw. What a peer starts is
ended with its session, and what it daemonised is found by its data folder, whatever happened between.
"""

import asyncio
import contextlib
import os
import signal
import socket
import subprocess
import time
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from bench.instance import ONE_ACCOUNT, Watched
from bench.peers.asking import PATIENCE_S, Asked, Asking, Blow
from bench.peers.guest import HANG_PATH
from bench.peers.recipes import HOME, ROOT, Ground, Recipe
from examples.guarded import GuardError
from hardcore.control import client

START_S = 30.0
#: A peer that has not brought a hung guest back by then never will, as far as anybody's patience goes.
HANG_S_MAX = 10.0
CRASH_S_MAX = 15.0
#: Between two blows: what was started for the last one has come to rest.
REST_S = 1.5
LOOK_EVERY_S = 0.02


@dataclass(slots=True)
class Outcome:
    """What one contestant's clients saw."""

    name: str
    crashes: list[Blow] = field(default_factory=list)
    hangs: list[Blow] = field(default_factory=list)
    fault: str = ""


class Contestant(Protocol):
    """Somebody who guards the guest."""

    address: tuple[str, int]

    async def at_rest(self) -> None:
        """Wait until what the last blow set going is over."""

    async def crash(self, last: Asked) -> int:
        """Kill whoever answers; return the monotonic moment in ns."""

    async def hang(self) -> int:
        """Put the event loop to sleep for good, in every guest; return the moment."""


class Guarded:
    """This guard, in front of its own ledger."""

    def __init__(self, instance: Watched, *, spare: bool) -> None:
        self.address = instance.address
        self._instance = instance
        self._spare = spare

    async def at_rest(self) -> None:
        """Wait for the report of the last incident, and for a spare where there is to be one."""
        await asyncio.to_thread(self._instance.quiet)
        give_up_at = time.monotonic() + START_S
        while self._spare and not (self._instance.status().get("spare") or {}).get("ready"):
            if time.monotonic() > give_up_at:
                raise GuardError(f"There is no spare after {START_S:g} s.")
            await asyncio.sleep(LOOK_EVERY_S)
        await asyncio.sleep(REST_S)

    async def crash(self, last: Asked) -> int:  # noqa: ARG002  # the guard knows who serves
        """Kill the core."""
        core = self._instance.core()
        try:
            return core.hit(signal.SIGKILL)
        finally:
            core.let_go()

    async def hang(self) -> int:
        """Have the core sleep on its loop: the drill `block`."""
        hit_ns = time.monotonic_ns()
        order = {"verb": "drill", "fault": "block", "yes": True}
        told = await asyncio.to_thread(client.ask, self._instance.folders.control, order)
        if told.get("ok") is not True:
            raise GuardError(f"The drill was refused: {told}")
        return hit_ns


class Peer:
    """Another supervisor."""

    def __init__(self, recipe: Recipe, ground: Ground, asking: Asking) -> None:
        self.address = ("127.0.0.1", ground.port)
        self._recipe = recipe
        self._asking = asking

    async def at_rest(self) -> None:
        """Wait for an answer, and then for everything else."""
        if await self._asking.well(START_S) is None:
            raise GuardError(f"{self._recipe.name} does not answer.")
        await asyncio.sleep(self._recipe.rest_s)

    async def crash(self, last: Asked) -> int:
        """Kill the process that gave the last good answer."""
        assert last.pid is not None, "the guest names itself"
        hit_ns = time.monotonic_ns()
        os.kill(last.pid, signal.SIGKILL)
        return hit_ns

    async def hang(self) -> int:
        """Ask each guest to hang; one that does takes no second question."""
        hit_ns = time.monotonic_ns()
        for _worker in range(self._recipe.workers):
            with contextlib.suppress(OSError, TimeoutError):
                async with asyncio.timeout(PATIENCE_S):
                    reader, writer = await asyncio.open_connection(*self.address)
                    writer.write(
                        f"POST {HANG_PATH} HTTP/1.1\r\nHost: guest\r\nContent-Length: 0\r\n\r\n".encode()
                    )
                    await reader.read(1)
                    writer.close()
        return hit_ns


async def fight(name: str, contestant: Contestant, asking: Asking, crashes: int, hangs: int) -> Outcome:
    """Hit a contestant so many times in each way while `asking` asks; return what was seen."""
    outcome = Outcome(name)
    try:
        for _round in range(crashes):
            outcome.crashes.append(await _blow(contestant, asking, CRASH_S_MAX, hang=False))
        for _round in range(hangs):
            outcome.hangs.append(await _blow(contestant, asking, HANG_S_MAX, hang=True))
            if outcome.hangs[-1].outage_ms is None:
                break  # once is enough: it never comes back
    except (GuardError, client.Unreachable, ProcessLookupError) as error:
        outcome.fault = str(error)
    return outcome


async def _blow(contestant: Contestant, asking: Asking, within_s: float, *, hang: bool) -> Blow:
    await contestant.at_rest()
    last = await asking.well(START_S)
    if last is None:
        raise GuardError("nobody answers before the blow")
    hit_ns = await contestant.hang() if hang else await contestant.crash(last)
    # The old one may answer what it had in hand: an answer is the successor's only if it was asked for well after.
    await asyncio.sleep(PATIENCE_S if hang else LOOK_EVERY_S)
    await asking.well(within_s)
    await asyncio.sleep(PATIENCE_S)  # what is open now gets its second
    return asking.blow(hit_ns, time.monotonic_ns())


@contextlib.asynccontextmanager
async def asking_at(address: tuple[str, int]) -> AsyncIterator[Asking]:
    """Ask at an address until the block ends."""
    asking = Asking(address, ONE_ACCOUNT)
    asking.start()
    try:
        yield asking
    finally:
        await asking.stop()


@contextlib.contextmanager
def running(recipe: Recipe, folder: Path, book: Path) -> Iterator[Ground]:
    """Start a peer on a book in a folder of its own; end everything it started when the block ends."""
    folder.mkdir(parents=True)
    environment = {
        "PATH": f"{HOME / 'venv' / 'bin'}:/usr/local/bin:/usr/bin:/bin",
        "HOME": str(folder),
        "PM2_HOME": str(folder / "pm2"),
        "HARDCORE_DATA": str(book),
    }
    ground = Ground(folder, _free_port(), environment)
    command = recipe.prepare(ground)
    with (folder / "output").open("wb") as output:
        process = subprocess.Popen(
            command, env=environment, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=output, stderr=output,
            start_new_session=True,
        )  # fmt: skip
    try:
        yield ground
    finally:
        process.send_signal(signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(2)
        _end_all(book)
        process.kill()
        process.wait()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


def _end_all(book: Path) -> None:
    """Kill every process whose environment names this book: some peers put their guests out of their session."""
    mark = f"HARDCORE_DATA={book}".encode()
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit() or int(entry.name) == os.getpid():
            continue
        with contextlib.suppress(OSError):
            if mark in (entry / "environ").read_bytes().split(b"\0"):
                os.kill(int(entry.name), signal.SIGKILL)
