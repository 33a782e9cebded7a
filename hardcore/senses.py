"""The further senses: what is asked or looked at beside the tick, each in its own time, told as facts.

Stacks, the store's locks, the core's health, the survey. All of it may be slow where the machine is ill, so none
of it shares a thread with the hands that start and end cores: one thread takes stacks and reads locks, one thread
surveys, and the health is asked for on the loop without waiting. What is not back in its time is a fact as well.
"""

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, assert_never

from hardcore.host import capability, clock, core_control, files, locks, probe
from hardcore.host.folders import Folders
from hardcore.host.lives import Life
from hardcore.host.survey import Survey
from hardcore.model import observations as seen
from hardcore.model.actions import LookAtStore, RestartComponent, SampleStacks, SetSafe
from hardcore.model.looks import LockHolder
from hardcore.model.verdicts import Diagnosis
from hardcore.snapshot import stacks
from hardcore.snapshot.subject import Tools

#: A debugger takes some 30 ms; on a machine that is busy up to ten times that.
STACKS_MS = 1000
#: Stacks of a suspicion that is older than this belong to another story.
FRESH_NS = 30_000_000_000
PROBE_S = 1.0
#: A core that goes safe only says so; one that is to leave it makes a write of its own first.
SAFE_ON_S, SAFE_OFF_S = 2.0, 4.0
#: A part that is ended and begun anew may have something under way to be ended first.
COMPONENT_S = 5.0
CLOSE_S = 0.5

#: Orders for which a living core is asked or looked at, beside the tick.
Sensing = SampleStacks | LookAtStore | SetSafe | RestartComponent


class Senses:
    """Looks and asks. `tell` takes the facts, on the loop; `note` a line for the log, on any thread."""

    def __init__(
        self,
        folders: Folders,
        generation: int,
        tools: Tools,
        tell: Callable[[seen.Observation], None],
        note: Callable[..., None],
    ) -> None:
        self._folders = folders
        self._generation = generation
        self._tools = tools
        self._tell = tell
        self._note = note
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="sense")
        self._at_stacks = self._at_store = False
        self._stacks: tuple[int, int, bytes] | None = None
        self._survey: Survey | None = None

    def first_stacks(self, life: int) -> bytes:
        """Return the newest look at the stacks of this life as evidence; empty if there is none, or an old one."""
        if self._stacks is None:
            return b""
        whose, at_ns, raw = self._stacks
        return raw if whose == life and clock.now_ns() - at_ns < FRESH_NS else b""

    async def sense(self, order: Sensing, life: Life) -> None:
        """Carry out an order that a living core is asked or looked at for; what comes of it is told."""
        match order:
            case SampleStacks():
                await self.sample_stacks(life)
            case LookAtStore():
                await self.look_at_store(life)
            case SetSafe():
                await self.set_safe(life, order.reason, on=order.on)
            case RestartComponent():
                await self._restart_component(life, order.name)
            case _:
                assert_never(order)

    async def sample_stacks(self, life: Life) -> None:
        """Look at all stacks without stopping anything; the answer comes in any case."""
        assert life.handle is not None, "only a process has stacks"
        if self._at_stacks:
            self._tell(seen.StacksSampled(clock.now_ns(), life.number, (), "an earlier look is not back yet"))
            return
        self._at_stacks = True
        until_ns = clock.now_ns() + STACKS_MS * 1_000_000
        try:
            found = await self._on_thread(stacks.sample, life.handle.pid, self._tools, until_ns)
        finally:
            self._at_stacks = False
        at_ns = clock.now_ns()
        if isinstance(found, str):
            self._tell(seen.StacksSampled(at_ns, life.number, (), found))
            return
        threads, raw = found
        self._stacks = (life.number, at_ns, raw)
        self._tell(seen.StacksSampled(at_ns, life.number, threads))

    async def look_at_store(self, life: Life) -> None:
        """Find out who holds the store's write lock, and have the disk looked at: the other thing it may wait for."""
        assert life.handle is not None, "only a process waits for a store"
        self.look_at_disk()
        if self._at_store:
            return  # the answer under way is as good
        self._at_store = True
        try:
            found = await self._on_thread(_holders, self._folders, life.handle.pid)
        finally:
            self._at_store = False
        if isinstance(found, str):
            self._note("store", locks=found)
            found = ()
        self._tell(seen.StoreLooked(clock.now_ns(), life.number, found))

    async def set_safe(self, life: Life, reason: Diagnosis, *, on: bool) -> None:
        """Have the serving core answer reads only, or everything again; the answer comes in any case."""
        order = {"verb": "safe", "on": on, "reason": str(reason), "generation": self._generation}
        within_s = SAFE_ON_S if on else SAFE_OFF_S
        refused = await core_control.give(self._folders.core_control(life.nonce), order, within_s)
        told = seen.SafeSwitched(clock.now_ns(), life.number, on=on, done=not refused, reason=refused)
        self._tell(told)

    async def _restart_component(self, life: Life, name: str) -> None:
        """Have the serving core start one of its parts anew; the answer comes in any case."""
        order = {"verb": "component", "name": name, "generation": self._generation}
        refused = await core_control.give(self._folders.core_control(life.nonce), order, COMPONENT_S)
        told = seen.ComponentRestarted(clock.now_ns(), life.number, name, done=not refused, reason=refused)
        self._tell(told)

    async def probe_on(self, serving: Callable[[], Life | None], interval_s: Callable[[], float]) -> None:
        """Ask whoever serves for its health, again and again; the pace may change meanwhile."""
        loop = asyncio.get_running_loop()
        while True:
            due = loop.time() + interval_s()
            life, asked_ns = serving(), clock.now_ns()
            if life is not None:
                health = await probe.ask_health(self._folders.core_socket(life.nonce), PROBE_S)
                if serving() is life:  # else it was answered, or not, by one that is leaving
                    self._tell(_probed(life, asked_ns, health))
            await asyncio.sleep(max(0.0, due - loop.time()))

    async def examine(self) -> None:
        """Try what this machine lets us see, and leave it in the run folder for whoever asks."""

        def dump(pid: int) -> str:
            found = stacks.sample(pid, self._tools, clock.now_ns() + STACKS_MS * 1_000_000)
            return found if isinstance(found, str) else ""

        def work() -> None:
            told = capability.examine(self._tools.py_spy, self._tools.gcore, dump)
            files.write_json(self._folders.capability, told, durable=False)

        await self._on_thread(work)

    # ---- the survey ----

    def begin_survey(self, interval_s: float) -> None:
        """Begin to survey on a thread of its own."""
        loop = asyncio.get_running_loop()

        def tell(surveyed: seen.Surveyed) -> None:
            loop.call_soon_threadsafe(self._tell, surveyed)

        def trouble(words: str) -> None:
            self._note("survey", failed=words)

        self._survey = Survey(self._folders.data, self._folders.state, interval_s, tell, trouble)
        self._survey.begin()

    def pace(self, interval_s: float) -> None:
        """Survey at this pace from now on."""
        if self._survey is not None:
            self._survey.interval_s = interval_s

    def watch(self, life: Life | None) -> None:
        """Survey this life from now on."""
        if self._survey is not None:
            self._survey.watch(life)

    def look_at_disk(self) -> None:
        """Have the disk looked at now, and written to."""
        if self._survey is not None:
            self._survey.ask()

    def close(self) -> None:
        """End what can be ended; a thread that hangs in the kernel ends with the process."""
        if self._survey is not None and not self._survey.close(CLOSE_S):
            self._note("unfinished", work="survey")
        self._thread.shutdown(wait=False, cancel_futures=True)

    async def _on_thread(self, work: Callable[..., Any], *args: Any) -> Any:
        return await asyncio.get_running_loop().run_in_executor(self._thread, work, *args)


def _probed(life: Life, asked_ns: int, health: probe.Health | None) -> seen.Probed:
    at_ns = clock.now_ns()
    if health is None:
        return seen.Probed(at_ns, life.number, asked_ns, answered=False)
    return seen.Probed(
        at_ns, life.number, asked_ns, True, health.epoch, health.seq, health.writes, health.safe
    )


def _holders(folders: Folders, core_pid: int) -> tuple[LockHolder, ...] | str:
    table = locks.read_table()
    return table if isinstance(table, str) else locks.writers_in(folders.data, core_pid, table)
