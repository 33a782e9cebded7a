"""The hands that hold court in the simulation: a throw-away core for each case, and what is written down.

What a trial shows is the truth of the world, unless a fault says that it is held badly. It ends with its guard. As with
the real hands, what the court remembers does not wait for the disk that takes its rules: a guard may die between the two.
"""

from typing import TYPE_CHECKING

from hardcore import quarantine_file
from hardcore.court_words import settled_by, unruled
from hardcore.model import trials
from hardcore.model.trials import CourtMemory, Ordeal
from hardcore.recovery.letters import letter as letter_of
from tests.simulation.clock import NS_PER_MS
from tests.simulation.harms import REPRODUCED, Harm
from tests.simulation.switches import Trying

if TYPE_CHECKING:  # guards have hands
    from tests.simulation.guard import Guard
    from tests.simulation.workload import Request

COPY_MS = (20, 600)
SLOW_COPY_MS = (20_000, 170_000)
CASE_MS = (5, 200)


class Courtroom:
    """One guard's hands."""

    def __init__(self, guard: "Guard") -> None:
        self.guard = guard
        self.world = guard.world
        self._sitting = 0
        self._limit_ms = 0

    def take_up(self, memory: CourtMemory | None) -> CourtMemory | None:
        """Go on where an earlier guard was: what it remembered as set aside gets its rule."""
        if memory is None:
            return None
        for one in unruled(memory, self.world.aside):
            self._set_aside(letter_of(one))
        return settled_by(memory, self.world.aside)

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
                self._set_aside(letter)
            case trials.Acquit():
                world.gateway.acquitted(order.name, run=order.run)
            case trials.KeepCourt():
                world.disk_court = order.memory
                world.gateway.suspected(note.name for note in order.suspects)
            case trials.StopSource() | trials.AddTrials():
                pass  # the checkers have looked at it

    def _set_aside(self, letter: trials.Letter) -> None:
        """Write its rule, for good; only then is anybody told."""
        self.guard.soon(self.world.switches.rule_write_ns, lambda: self._rule_is_written(letter))

    def _rule_is_written(self, letter: trials.Letter) -> None:
        world = self.world
        if world.aside.rule(letter.id) is None and letter.id not in world.aside.released:
            world.aside = quarantine_file.set_aside(world.aside, letter, {})
            world.letters[letter.id] = letter
            if letter.seq is not None:
                world.store.parked.add(letter.seq)
        if world.aside.rule(letter.id) is not None:
            world.gateway.set_aside(letter.name)

    def _sit(self, names: tuple[str, ...], limit_ms: int) -> None:
        self._sitting += 1
        self._limit_ms = limit_ms
        trying = self.world.switches.trying()
        wait_ns = self._copy(trying)
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
        wait_ns = self._copy(trying)
        found = sorted(seq for seq in self.world.store.lethal - self.world.store.parked if seq > after_seq)
        if trying is Trying.HANGS:
            return
        now_ns = self.world.clock.now_ns
        if found and trying is Trying.KILLED:
            self._say(wait_ns, trials.Tried(now_ns, "", Ordeal.DIED, 5, signal=9, seq=found[0]))
        if trying is Trying.UNTRIED:
            self._say(wait_ns, trials.Tried(now_ns, "", Ordeal.UNTRIED, 5, why="nobody could"))
        if found and trying in {Trying.HELD, Trying.SLOW, Trying.COPIES}:
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

    def _copy(self, trying: Trying) -> int:
        """Begin to copy the ledger; return how long that takes."""
        wait_ns = self._wait_ns(SLOW_COPY_MS if trying is Trying.COPIES else COPY_MS)
        if trying is not Trying.HANGS:
            self._say(wait_ns, trials.CourtAtWork(self.world.clock.now_ns))
        return wait_ns

    def _say(self, wait_ns: int, fact: trials.Tried | trials.CourtAtWork) -> None:
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
