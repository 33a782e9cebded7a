"""What faults have prepared for the machine's next moves: how a boot goes, whether a process can be made.

A fault turns a switch and is done; the world asks it when the moment comes. Where nothing is prepared,
everything goes well, in a time that is left to chance.
"""

from collections import deque
from dataclasses import dataclass, field
from enum import Enum
from random import Random

from tests.simulation.clock import NS_PER_MS
from tests.simulation.machine import BootPlan


class Taking(Enum):
    """How taking the evidence goes."""

    IN_TIME = "in time"
    LATE = "late"
    NEVER = "never"
    DIES = "the core dies in the middle of it"


class Looking(Enum):
    """How a look at a core's stacks goes."""

    WORKS = "works"
    DENIED = "nobody may look"
    NEVER = "it never comes back"


class Draining(Enum):
    """How the next order to drain goes."""

    OBEYED = "obeyed"
    REFUSED = "refused"
    NEVER = "never answered"
    DIES = "the core dies of it"


class Order(Enum):
    """How the next order to read only, or to write again, goes."""

    OBEYED = "obeyed"
    LOST = "lost"
    REFUSED = "refused"
    LATE = "late"


class Trying(Enum):
    """How the next court goes."""

    HELD = "held"
    HANGS = "it never says anything"
    DIES = "it ends in the middle"
    UNTRIED = "nobody can be tried"
    KILLED = "each core in it is killed from outside"
    SLOW = "each case is slow, once"
    COPIES = "the copy of the ledger takes minutes"


@dataclass(slots=True)
class Switches:
    """See the module. `tick_late_ns`: the guard's ticks come up to so much late for a while.

    `late_every`: of its ticks every so many comes `late_by_ns` late, to the end of the world; 0: none.
    """

    rng: Random
    boot_plans: deque[BootPlan] = field(default_factory=deque)
    slow_spawns_ns: deque[int] = field(default_factory=deque)
    evidence: deque[Taking] = field(default_factory=deque)
    failing_spawns: int = 0
    tick_late_ns: int = 0
    late_every: int = 0
    late_by_ns: int = 0
    orders_until_death: int | None = None
    safe_orders: deque[Order] = field(default_factory=deque)
    spare_plans: deque[BootPlan] = field(default_factory=deque)
    drains: deque[Draining] = field(default_factory=deque)
    trials: deque[Trying] = field(default_factory=deque)
    part_again: int = 0  # so often a part that was begun anew stands still again, or is not begun at all
    court_hung: bool = False  # some court was given up before it was over
    #: What it takes to write a rule, for good.
    rule_write_ns: int = NS_PER_MS
    looking: Looking = Looking.WORKS
    #: What a small write of the guard's own takes.
    own_write_ns: int = NS_PER_MS
    #: Until then the kernel says nothing about any process.
    unseen_until_ns: int = 0

    def clear(self) -> None:
        """Everything goes well from now on."""
        for prepared in (self.boot_plans, self.slow_spawns_ns, self.evidence, self.safe_orders):
            prepared.clear()
        self.spare_plans.clear()
        self.drains.clear()
        self.trials.clear()
        self.part_again = 0
        self.failing_spawns, self.tick_late_ns, self.orders_until_death = 0, 0, None
        self.own_write_ns, self.unseen_until_ns = NS_PER_MS, 0
        self.rule_write_ns = NS_PER_MS

    def late_ns(self, ticks: int) -> int:
        """How late the guard's next tick comes after so many."""
        if self.late_every and ticks % self.late_every == 0:
            return self.late_by_ns
        return self.rng.randrange(self.tick_late_ns or 5 * NS_PER_MS)

    def boot_plan(self, *, prepared: bool) -> BootPlan:
        """How the next boot goes; without what faults have `prepared`: well."""
        ms = NS_PER_MS
        plan = BootPlan(self.rng.randrange(20, 200) * ms, self.rng.randrange(1, 60) * ms)
        return self.boot_plans.popleft() if prepared and self.boot_plans else plan

    def spare_plan(self) -> BootPlan:
        """How the next spare warms up and takes over."""
        if self.spare_plans:
            return self.spare_plans.popleft()
        ms = NS_PER_MS
        return BootPlan(self.rng.randrange(20, 400) * ms, self.rng.randrange(1, 60) * ms)

    def draining(self) -> Draining:
        """How the next order to drain goes."""
        return self.drains.popleft() if self.drains else Draining.OBEYED

    def spawn_takes_ns(self) -> int:
        """How long it takes to make a process, or to find out that none can be made."""
        if self.slow_spawns_ns:
            return self.slow_spawns_ns.popleft()
        return self.rng.randrange(1, 40) * NS_PER_MS

    def spawn_fails(self) -> bool:
        """Whether no process can be made just now."""
        if self.failing_spawns == 0:
            return False
        self.failing_spawns -= 1
        return True

    def taking(self) -> Taking:
        """How taking the next evidence goes."""
        return self.evidence.popleft() if self.evidence else Taking.IN_TIME

    def trying(self) -> Trying:
        """How the next court goes."""
        trying = self.trials.popleft() if self.trials else Trying.HELD
        self.court_hung = self.court_hung or trying is Trying.HANGS
        return trying

    def safe_order(self) -> Order:
        """How the next order to read only goes."""
        return self.safe_orders.popleft() if self.safe_orders else Order.OBEYED

    def guard_dies_now(self) -> bool:
        """Whether the next order is never carried out, because the guard dies before it."""
        if self.orders_until_death is None:
            return False
        self.orders_until_death -= 1
        return self.orders_until_death < 0
