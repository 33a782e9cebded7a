"""The client of every contest: a question every 5 ms, each on a connection of its own, and what became of each.

A fresh connection is what a new visitor has, and the hardest case: a kept one would hide that nobody listens. A
question is given a second, as the measurements that this repeats gave it; one that was refused, reset, closed without
an answer, answered with anything but 200 or not answered in that second has failed. The client runs in the killer's
own process and clock, and is itself late when the machine is: the same for everybody.
"""

import asyncio
import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass

EVERY_S = 0.005
PATIENCE_S = 1.0
HEAD_BYTES_MAX = 1 << 16


@dataclass(frozen=True, slots=True)
class Asked:
    """One question: monotonic times in ns, and whether it was answered well. `pid`: who said that it answered."""

    asked_ns: int
    told_ns: int
    good: bool
    pid: int | None = None

    @property
    def took_ms(self) -> float:
        """How long the client waited."""
        return (self.told_ns - self.asked_ns) / 1e6


@dataclass(frozen=True, slots=True)
class Blow:
    """What the clients saw of one blow: the longest wait, failures, and when the longest silence after it was over.

    `outage_ms` counts from the blow; None: nobody was answered any more.
    """

    longest_ms: float
    failed: int
    outage_ms: float | None


class Asking:
    """Asks `path` at `address` until it is told to stop."""

    def __init__(self, address: tuple[str, int], path: str) -> None:
        self.asked: list[Asked] = []
        self._address = address
        self._question = (
            f"GET {path} HTTP/1.1\r\nHost: {address[0]}:{address[1]}\r\nConnection: close\r\n\r\n".encode()
        )
        self._running: set[asyncio.Task[None]] = set()
        self._pace: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Begin to ask."""
        self._pace = asyncio.get_running_loop().create_task(self._ask_on())

    async def stop(self) -> None:
        """Ask nothing more, and wait for what is under way."""
        assert self._pace is not None, "it was started"
        self._pace.cancel()
        if self._running:
            await asyncio.wait(self._running)

    async def well(self, within_s: float, fits: Callable[[Asked], bool] = lambda _: True) -> Asked | None:
        """Wait for a good answer to a question that is asked from now on and that `fits`; None: none came."""
        since_ns = time.monotonic_ns()
        give_up_ns = since_ns + int(within_s * 1e9)
        while time.monotonic_ns() < give_up_ns:
            for one in reversed(self.asked):
                if one.asked_ns >= since_ns and one.good and fits(one):
                    return one
            await asyncio.sleep(EVERY_S)
        return None

    def blow(self, hit_ns: int, until_ns: int) -> Blow:
        """Return what was seen of a blow at `hit_ns`, in the questions that were open or asked until `until_ns`."""
        met = [one for one in self.asked if one.told_ns >= hit_ns and one.asked_ns < until_ns]
        return Blow(
            max((one.took_ms for one in met), default=0.0),
            sum(not one.good for one in met),
            _silence_over_ms(hit_ns, until_ns, [min(one.told_ns, until_ns) for one in met if one.good]),
        )

    async def _ask_on(self) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            task = loop.create_task(self._ask())
            self._running.add(task)
            task.add_done_callback(self._running.discard)
            due = max(due + EVERY_S, loop.time())
            await asyncio.sleep(due - loop.time())

    async def _ask(self) -> None:
        asked_ns, good, pid = time.monotonic_ns(), False, None
        try:
            async with asyncio.timeout(PATIENCE_S):
                good, pid = await self._once()
        except (OSError, TimeoutError, asyncio.IncompleteReadError, ValueError):
            good = False
        self.asked.append(Asked(asked_ns, time.monotonic_ns(), good, pid))

    async def _once(self) -> tuple[bool, int | None]:
        reader, writer = await asyncio.open_connection(*self._address, limit=HEAD_BYTES_MAX)
        try:
            writer.write(self._question)
            head = await reader.readuntil(b"\r\n\r\n")
            fields = {
                name.strip().lower(): value.strip()
                for name, _, value in (line.partition(b":") for line in head.split(b"\r\n")[1:])
            }
            await reader.readexactly(int(fields.get(b"content-length", b"0")))
            pid = fields.get(b"x-guest-pid")
            return head.split(b" ", 2)[1] == b"200", int(pid) if pid else None
        finally:
            writer.close()


def _silence_over_ms(hit_ns: int, until_ns: int, told_ns: list[int]) -> float | None:
    """Return how long after the blow the longest time without a good answer was over; None: it was not."""
    moments = [hit_ns, *sorted(told_ns)]
    if until_ns - moments[-1] >= PATIENCE_S * 1e9:
        return None
    silences = [(end - begin, end) for begin, end in itertools.pairwise(moments)]
    return (max(silences)[1] - hit_ns) / 1e6 if silences else None
