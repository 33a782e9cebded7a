"""The guard's senses on a real core: its stacks, its store's lock, its health, its switch to reading, its limits."""

import asyncio
import json
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TypeVar

import pytest

from hardcore import endings
from hardcore.bounds import Bounds
from hardcore.executor import Executor
from hardcore.host.folders import Folders
from hardcore.host.ids import new_id
from hardcore.host.lives import CoreLimits, Life
from hardcore.host.notify import NotifySocket
from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.verdicts import Diagnosis
from hardcore.sentinel.heartbeat import NOTICE_BYTES_MAX, MalformedNotice, read_notice
from hardcore.snapshot.image import ImageLimits

BOUNDS = Bounds(CoreLimits(4321, 300 << 20), ImageLimits(1000, 1 << 30))
GIVE_UP_S = 40.0
LOOKS_MAX = 5
Fact = TypeVar("Fact")


class House:
    """Hands with a real core in them, and all that they told."""

    def __init__(self, folders: Folders) -> None:
        self.folders = folders
        self.facts: list[seen.Observation] = []
        self.executor = Executor(folders, 1, self.facts.append, lambda _line: None, lambda: None, BOUNDS)
        self._ear = NotifySocket(folders.notify, NOTICE_BYTES_MAX)
        asyncio.get_running_loop().add_reader(self._ear.fileno(), self._heard)
        self.ready = asyncio.Event()

    def _heard(self) -> None:
        for _, datagram in self._ear.waiting():
            notice = read_notice(datagram)
            assert not isinstance(notice, MalformedNotice), notice
            if notice.ready:
                self.ready.set()

    async def told(self, kind: type[Fact], count: int = 1) -> Fact:
        """Wait for the fact of this kind that was told as the `count`th."""
        deadline = asyncio.get_running_loop().time() + GIVE_UP_S
        while len(found := [fact for fact in self.facts if isinstance(fact, kind)]) < count:
            assert asyncio.get_running_loop().time() < deadline, f"waited for {kind.__name__}"
            await asyncio.sleep(0.005)
        return found[count - 1]

    async def spawn(self, number: int = 1) -> Life:
        self.ready.clear()
        self.executor.carry_out(orders.Spawn(number, None, ()))
        await self.told(seen.CoreSpawned, number)
        return self.executor.lives[number]

    async def stacks(self, looks: int) -> seen.StacksSampled:
        """Have the stacks of life 1 looked at for the `looks`th time."""
        self.executor.carry_out(orders.SampleStacks(1))
        return await self.told(seen.StacksSampled, looks)

    async def serving(self) -> Life:
        life = await self.spawn()
        await asyncio.wait_for(self.ready.wait(), GIVE_UP_S)
        return life

    async def close(self) -> None:
        for life in self.executor.lives.values():
            self.executor.carry_out(orders.Kill(life.number))
            assert life.handle is not None, "it was spawned"
        await self.told(seen.CoreExited, len([f for f in self.facts if isinstance(f, seen.CoreSpawned)]))
        await self.executor.finish()
        asyncio.get_running_loop().remove_reader(self._ear.fileno())
        self._ear.close()
        for life in self.executor.lives.values():
            life.discard()


Lived = Callable[[Callable[[House], Awaitable[None]]], None]


@pytest.fixture
def lived(tmp_path: Path) -> Lived:
    """Run a scenario in a house of its own."""
    folders = Folders(tmp_path, tmp_path / "run")
    for folder in (folders.run, folders.logs, folders.incidents, folders.state):
        folder.mkdir()

    def live(scenario: Callable[[House], Awaitable[None]]) -> None:
        async def run() -> None:
            house = House(folders)
            try:
                await scenario(house)
            finally:
                await house.close()

        asyncio.run(run())

    return live


def test_the_stacks_of_a_core_that_serves_are_looked_at_for_free_and_kept_as_first_evidence(
    lived: Lived,
) -> None:
    async def scenario(house: House) -> None:
        life = await house.serving()
        told = await house.stacks(1)
        for looks in range(2, LOOKS_MAX + 1):  # a thread that moves under the look may spoil one
            spoilt = told.fault or not all(stack.frames for stack in told.stacks)
            told = await house.stacks(looks) if spoilt else told
        if "permission" in told.fault.lower():
            pytest.skip(told.fault)
        assert not told.fault, "a core that may be traced is seen"
        assert life.handle is not None
        assert life.sample is None or life.sample.state != "T"
        main = next(stack for stack in told.stacks if stack.tid == life.handle.pid)
        assert "<module>" in {frame.function for frame in main.frames}, "the program's own frame"
        raw = house.executor.senses.first_stacks(1)
        assert json.loads(raw)
        assert house.executor.senses.first_stacks(2) == b"", "they are another life's"

    lived(scenario)


def test_two_looks_at_once_get_two_answers_and_one_debugger(lived: Lived) -> None:
    async def scenario(house: House) -> None:
        await house.serving()
        for _ in range(2):
            house.executor.carry_out(orders.SampleStacks(1))
        first, second = await house.told(seen.StacksSampled), await house.told(seen.StacksSampled, 2)
        assert first.fault == "an earlier look is not back yet"
        assert second.fault != first.fault

    lived(scenario)


def test_a_store_that_nobody_writes_to_has_no_holder(lived: Lived) -> None:
    async def scenario(house: House) -> None:
        await house.serving()
        house.executor.carry_out(orders.LookAtStore(1))
        assert (await house.told(seen.StoreLooked)).holders == ()

    lived(scenario)


def test_who_holds_the_stores_lock_from_outside_is_named(lived: Lived) -> None:
    async def scenario(house: House) -> None:
        await house.serving()
        argv = [
            sys.executable,
            "-m",
            "core",
            "hold-lock",
            "--data",
            str(house.folders.data),
            "--seconds",
            "60",
        ]
        holder = await asyncio.create_subprocess_exec(*argv, stdout=asyncio.subprocess.PIPE)
        assert holder.stdout is not None
        try:
            assert await holder.stdout.readline()
            house.executor.carry_out(orders.LookAtStore(1))
            (told,) = (await house.told(seen.StoreLooked)).holders
            assert (told.pid, told.ours) == (holder.pid, False)
            assert told.name.startswith("python")
        finally:
            holder.kill()
            await holder.communicate()

    lived(scenario)


def test_evidence_beside_a_core_that_goes_on_does_not_stop_it_and_has_the_first_look(lived: Lived) -> None:
    async def scenario(house: House) -> None:
        life = await house.serving()
        house.executor.carry_out(orders.SampleStacks(1))
        looked = await house.told(seen.StacksSampled)
        incident = new_id()
        order = orders.TakeEvidence(1, incident, living=True, budget_ms=2000, stop=False)
        house.executor.carry_out(order)
        await house.told(seen.EvidenceTaken)
        sample = life.look().process
        assert sample is not None
        assert sample.state != "T"
        there = {path.name for path in (house.folders.incidents / incident).iterdir()}
        assert "recorder.json" in there
        assert ("stacks-first.json" in there) is not bool(looked.fault)

    lived(scenario)


def test_a_core_that_serves_is_in_good_health_and_one_that_is_gone_is_asked_no_more(lived: Lived) -> None:
    async def scenario(house: House) -> None:
        life = await house.serving()
        serving: list[Life | None] = [life]
        probing = asyncio.ensure_future(house.executor.senses.probe_on(lambda: serving[0], lambda: 0.01))
        try:
            told = await house.told(seen.Probed, 2)
            assert told.answered
            assert told.epoch == 1
            assert told.seq is not None
            assert told.asked_ns <= told.at_ns
            serving[0] = None
            count = len([fact for fact in house.facts if isinstance(fact, seen.Probed)])
            await asyncio.sleep(0.05)
            assert len([fact for fact in house.facts if isinstance(fact, seen.Probed)]) == count
        finally:
            probing.cancel()

    lived(scenario)


def test_a_core_that_is_stopped_does_not_answer_for_its_health(
    lived: Lived, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hardcore.senses.PROBE_S", 0.1)

    async def scenario(house: House) -> None:
        life = await house.serving()
        assert life.handle is not None
        life.handle.signal(19)
        probing = asyncio.ensure_future(house.executor.senses.probe_on(lambda: life, lambda: 0.01))
        try:
            assert not (await house.told(seen.Probed)).answered
        finally:
            probing.cancel()

    lived(scenario)


def test_a_core_serves_reads_only_and_everything_again_as_it_is_told(lived: Lived) -> None:
    async def scenario(house: House) -> None:
        await house.serving()
        house.executor.carry_out(orders.SetSafe(1, on=True, reason=Diagnosis.DISK_FULL))
        on = await house.told(seen.SafeSwitched)
        assert (on.on, on.done, on.reason) == (True, True, "")
        house.executor.carry_out(orders.SetSafe(1, on=False, reason=Diagnosis.DISK_FULL))
        off = await house.told(seen.SafeSwitched, 2)
        assert (off.on, off.done, off.reason) == (False, True, "")

    lived(scenario)


def test_a_core_is_told_the_limits_of_the_policy_and_why_it_only_reads(lived: Lived) -> None:
    async def scenario(house: House) -> None:
        house.executor.carry_out(orders.Spawn(1, None, (), safe=Diagnosis.DISK_FULL))
        told = await house.told(seen.CoreSpawned)
        environment = Path(f"/proc/{told.pid}/environ").read_bytes().split(b"\0")
        assert b"HARDCORE_LIMIT_MS=4321" in environment
        assert f"HARDCORE_MEMORY_BYTES={300 << 20}".encode() in environment
        assert b"HARDCORE_SAFE=DISK_FULL" in environment

    lived(scenario)


def test_a_core_that_was_confined_leaves_no_group_behind_and_its_death_says_that_nobody_ran_out(
    lived: Lived,
) -> None:
    async def scenario(house: House) -> None:
        life = await house.serving()
        why = await house.executor.confine(life)
        if why is not None:
            pytest.skip(why)
        assert await house.executor.confine(life) is None, "it is confined already"
        assert life.confined is not None
        group = life.confined.group.folder
        house.executor.carry_out(orders.Kill(1))
        told = await house.told(seen.CoreExited)
        assert told.oom_kills == 0
        deadline = asyncio.get_running_loop().time() + GIVE_UP_S
        while group.exists():
            assert asyncio.get_running_loop().time() < deadline, "the group is still there"
            life.dissolve()
            await asyncio.sleep(0.005)

    lived(scenario)


def test_fifty_lives_with_all_senses_on_leave_descriptors_and_threads_as_they_were(
    lived: Lived, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(endings, "LIVES_KEPT_MAX", 1)

    def held() -> tuple[int, int]:
        return len(list(Path("/proc/self/fd").iterdir())), len(list(Path("/proc/self/task").iterdir()))

    async def scenario(house: House) -> None:
        house.executor.senses.begin_survey(0.01)
        counts = []
        for number in range(1, 51):
            life = await house.spawn(number)
            house.executor.senses.watch(life)
            for order in (orders.SampleStacks, orders.LookAtStore):
                house.executor.carry_out(order(number))
            life.look()
            await house.told(seen.StacksSampled, number)
            await house.told(seen.StoreLooked, number)
            house.executor.carry_out(orders.Kill(number))
            await house.told(seen.CoreExited, number)
            counts.append(held())
        # The fewest: a sense that is still at work when we count is none that was left behind.
        early, late = counts[5:15], counts[-10:]
        assert min(fds for fds, _ in late) <= min(fds for fds, _ in early) + 2, counts
        assert min(threads for _, threads in late) <= min(threads for _, threads in early) + 1, counts

    lived(scenario)
