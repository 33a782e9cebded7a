"""The hands that hold court in the simulation: a throw-away core for each case, and what is written down.

What a trial shows is the truth of the world, unless a fault says that it is held badly. It ends with its guard.
"""

from typing import TYPE_CHECKING

from hardcore.model import trials
from hardcore.model.trials import Ordeal
from tests.simulation.clock import NS_PER_MS
from tests.simulation.harms import REPRODUCED, Harm
from tests.simulation.switches import Trying

if TYPE_CHECKING:  # guards have hands
    from tests.simulation.guard import Guard
    from tests.simulation.workload import Request

COPY_MS = (20, 600)
CASE_MS = (5, 200)


class Courtroom:
    """One guard's hands."""

    def __init__(self, guard: "Guard") -> None:
        self.guard = guard
        self.world = guard.world
        self._sitting = 0
        self._limit_ms = 0

    def carry_out(self, order: trials.TrialAction) -> None:
        """Obey."""
        world = self.world
        match order:
            case trials.Try():
                self._sit(order.names, order.limit_ms)
            case trials.TryLog():
                self._sit_on_log(order.after_seq)
            case trials.EndTrials():
                self._end("")
            case trials.SetAside(letter=letter):
                world.set_aside[letter.name if letter.seq is None else letter.id] = letter
                if letter.seq is not None:
                    world.store.parked.add(letter.seq)
                world.gateway.set_aside(letter.name)
            case trials.Acquit():
                world.gateway.acquitted(order.name, run=order.run)
            case trials.KeepCourt():
                world.disk_court = order.memory
                world.gateway.suspects = frozenset(note.name for note in order.suspects)
            case trials.StopSource() | trials.AddTrials():
                pass  # the checkers have looked at it

    def _sit(self, names: tuple[str, ...], limit_ms: int) -> None:
        self._sitting += 1
        self._limit_ms = limit_ms
        trying = self.world.switches.trying()
        wait_ns = self._wait_ns(COPY_MS)
        if trying is Trying.HANGS:
            return
        for number, name in enumerate(names):
            if trying is Trying.DIES and number >= len(names) // 2:
                break
            took_ns = self._wait_ns(CASE_MS)
            fact = self._tried(name, trying, took_ns)
            if fact.ordeal is Ordeal.HUNG:
                took_ns = limit_ms * NS_PER_MS
            wait_ns += took_ns
            self._say(wait_ns, fact)
        self._over(wait_ns + NS_PER_MS, "it was killed" if trying is Trying.DIES else "")

    def _sit_on_log(self, after_seq: int) -> None:
        self._sitting += 1
        trying = self.world.switches.trying()
        wait_ns = self._wait_ns(COPY_MS)
        found = sorted(seq for seq in self.world.store.lethal - self.world.store.parked if seq > after_seq)
        if trying is Trying.HANGS:
            return
        now_ns = self.world.clock.now_ns
        if found and trying is Trying.KILLED:
            self._say(wait_ns, trials.Tried(now_ns, "", Ordeal.DIED, 5, signal=9, seq=found[0]))
        if trying is Trying.UNTRIED:
            self._say(wait_ns, trials.Tried(now_ns, "", Ordeal.UNTRIED, 5, why="nobody could"))
        if found and trying in {Trying.HELD, Trying.SLOW}:
            self._say(wait_ns, trials.Tried(now_ns, "", Ordeal.DIED, 5, signal=11, seq=found[0]))
        self._over(wait_ns + NS_PER_MS, "it was killed" if trying is Trying.DIES else "")

    def _tried(self, name: str, trying: Trying, took_ns: int) -> trials.Tried:
        world, took_ms = self.world, took_ns // NS_PER_MS
        case = world.cases.get(name)
        if case is None or trying is Trying.UNTRIED:
            return trials.Tried(world.clock.now_ns, name, Ordeal.UNTRIED, took_ms, why="nobody could")
        if trying is Trying.KILLED:
            return trials.Tried(world.clock.now_ns, name, Ordeal.DIED, took_ms, signal=9)
        if trying is Trying.SLOW and name not in world.slowed:
            world.slowed.add(name)
            return trials.Tried(world.clock.now_ns, name, Ordeal.HUNG, took_ms)
        return self._truth(name, case, took_ms)

    def _truth(self, name: str, case: "Request", took_ms: int) -> trials.Tried:
        now_ns = self.world.clock.now_ns
        if case.keyed and case.key in self.world.store.keys:
            return trials.Tried(now_ns, name, Ordeal.COMMITTED, took_ms)
        if case.harm not in REPRODUCED:
            return trials.Tried(now_ns, name, Ordeal.SURVIVED, took_ms)
        if case.harm is Harm.BLOCK:
            return trials.Tried(now_ns, name, Ordeal.HUNG, took_ms)
        if case.harm is Harm.EXIT:
            return trials.Tried(now_ns, name, Ordeal.DIED, took_ms, code=1)
        return trials.Tried(now_ns, name, Ordeal.DIED, took_ms, signal=11)

    def _say(self, wait_ns: int, fact: trials.Tried) -> None:
        sitting = self._sitting

        def say() -> None:
            if sitting == self._sitting and self.guard.works:
                self.guard.tell(fact)

        self.world.clock.after(wait_ns, say)

    def _over(self, wait_ns: int, fault: str) -> None:
        sitting = self._sitting

        def over() -> None:
            if sitting == self._sitting and self.guard.works:
                self._end(fault)

        self.world.clock.after(wait_ns, over)

    def _end(self, fault: str) -> None:
        self._sitting += 1
        self.guard.tell(trials.TrialsOver(self.world.clock.now_ns, fault))

    def _wait_ns(self, bounds_ms: tuple[int, int]) -> int:
        return self.world.rng.randrange(*bounds_ms) * NS_PER_MS
