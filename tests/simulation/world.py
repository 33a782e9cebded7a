"""The simulated machine: one clock, one store, cores, a gateway with clients, and the guard of the moment.

The world owns what outlives any process (the store, what a guard wrote to disk, the operator's word) and
the switches that faults turn. What it knows is the truth; the guard inside only hears what it would hear.
"""

from collections import deque
from functools import partial
from random import Random

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.phases import Wanted
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.policy import Policy, Word
from tests.simulation.checkers import Checkers
from tests.simulation.clock import NS_PER_MS, NS_PER_S, Clock
from tests.simulation.conditions import FROZEN, STARVED, WELL, WRITER_ASLEEP, WRITER_GONE, Condition, Judged
from tests.simulation.guard import Guard
from tests.simulation.machine import BootPlan, Life, Store
from tests.simulation.workload import Gateway, Request

STUCK_FOR_EVER = 0.1
WRITER_STOPS = frozenset({WRITER_ASLEEP, WRITER_GONE})


class World:
    """See the module."""

    def __init__(self, seed: int, policy: Policy) -> None:
        self.clock = Clock()
        self.rng = Random(seed)
        self.policy = policy
        self.store = Store()
        self.lives: list[Life] = []
        self.guards: list[Guard] = []
        self.quiet = False
        self.stranger_raised = False
        self.stuck_for_ever = False
        self.disk_wanted = Wanted.UP
        self.disk_deaths_ns: tuple[int, ...] = ()
        self.boot_plans: deque[BootPlan] = deque()
        self.failing_spawns = 0
        self.slow_spawns_ns: deque[int] = deque()
        self.evidence: deque[str] = deque()
        self.orders_until_death: int | None = None
        self.tick_late_ns = 0
        self.checkers = Checkers(self)
        self.gateway = Gateway(self)

    # ---- who is there ----

    @property
    def guard(self) -> Guard:
        """The sentinel of the moment (or the last one)."""
        return self.guards[-1]

    @property
    def core(self) -> Life | None:
        """The living core, if there is one."""
        return next((life for life in reversed(self.lives) if life.alive), None)

    def begin_guard(self) -> None:
        """A sentinel starts, with what its predecessor left on disk and in the process table."""
        guard = Guard(self, len(self.guards) + 1, self.policy, self.disk_wanted, self.disk_deaths_ns)
        self.guards.append(guard)
        self.checkers.began(guard)
        if guard.number > 1:
            self.gateway.renewed()
        pages = [page for life in self.lives if (page := life.page()) is not None and page.witness]
        last = max(pages, key=lambda page: page.witness.seq if page.witness else 0, default=None)
        guard.hear(seen.SentinelBegan(self.clock.now_ns, self.core is not None, last))

    def kill_guard(self) -> None:
        """The sentinel dies; somebody starts another."""
        guard = self.guard
        if not guard.works:
            return
        guard.alive = False
        self.orders_until_death = None
        for _ in range(guard.lose_spawns()):
            if self.rng.random() < 0.5:
                self.make_life(0, None)
        self.checkers.guard_died()
        self.clock.after(self.rng.randrange(50, 600) * NS_PER_MS, self.begin_guard)

    def guard_halted(self) -> None:
        """The sentinel has ended as asked; perhaps somebody wants it again."""
        if not self.quiet and self.rng.random() < 0.7:
            self.clock.after(self.rng.randrange(100, 3000) * NS_PER_MS, self._up_again)

    def _up_again(self) -> None:
        self.disk_wanted = Wanted.UP
        self.begin_guard()

    # ---- what the machine does for the guard ----

    def guard_dies_now(self) -> bool:
        """Whether the next order is never carried out, because the guard dies before it."""
        if self.orders_until_death is None:
            return False
        self.orders_until_death -= 1
        return self.orders_until_death < 0

    def spawn_fails(self) -> bool:
        """Whether no process can be made just now."""
        if self.failing_spawns == 0:
            return False
        self.failing_spawns -= 1
        return True

    def spawn_takes_ns(self) -> int:
        """How long it takes to make a process, or to find out that none can be made."""
        if self.slow_spawns_ns:
            return self.slow_spawns_ns.popleft()
        return self.rng.randrange(1, 40) * NS_PER_MS

    def make_life(self, number: int, expected: int | None) -> Life:
        """A core process begins."""
        ms = NS_PER_MS
        plan = BootPlan(self.rng.randrange(20, 200) * ms, self.rng.randrange(1, 60) * ms)
        if self.boot_plans:
            plan = self.boot_plans.popleft()
        life = Life(self, number, len(self.lives) + 1, expected, plan)
        life.guard = self.guard.number
        self.lives.append(life)
        return life

    def evidence_takes_ns(self, life: Life, order: orders.TakeEvidence) -> int | None:
        """How long the evidence takes; None: it never comes."""
        mode = self.evidence.popleft() if self.evidence else "in time"
        if mode == "never":
            return None
        if mode == "late":
            return (order.budget_ms + self.rng.randrange(200, 3000)) * NS_PER_MS
        if mode == "dies":
            self.clock.after(self.rng.randrange(50) * NS_PER_MS, lambda: life.signal(9))
        return self.rng.randrange(20, order.budget_ms + 1) * NS_PER_MS

    # ---- what cores tell ----

    def tell(self, life: Life, fact: seen.Observation) -> None:
        """A core's datagram: it reaches the guard that started it, and no other."""
        if life.guard == self.guard.number:
            self.guard.tell(fact)

    def to_guard(self, fact: seen.Observation) -> None:
        """A fact from the gateway."""
        self.guard.tell(fact)

    def answered(self, life: Life, request: Request) -> None:
        """A core answers."""
        self.gateway.answered(life, request)

    def died(self, life: Life) -> None:
        """A core is gone."""
        self.gateway.died(life)
        if self.guard.works:
            self.guard.died(life)

    def worry(self) -> None:
        """Something is the matter: the guard's ticks matter from now on."""
        if self.guard.works:
            self.guard.watch()

    # ---- what faults do ----

    def befall(self, condition: Condition, for_ns: int | None = None) -> None:
        """Something befalls the living core, between two ticks of the watch."""
        life = self.core
        if life is not None and life.condition is WELL:
            self.worry()

            self.clock.after(
                self.rng.randrange(100) * NS_PER_MS, lambda: self._begin(life, condition, for_ns)
            )

    def _begin(self, life: Life, condition: Condition, for_ns: int | None) -> None:
        if self.quiet or life.condition is not WELL:
            return  # something else came first
        if condition in WRITER_STOPS and life.taken:
            # Asleep in the middle of a command is another fault, which this guard does not judge yet.
            self.clock.after(3 * NS_PER_MS, lambda: self._begin(life, condition, for_ns))
            return
        life.befall(condition, for_ns)

    def ask(self, verb: seen.Verb) -> None:
        """The operator speaks; what he wants is on disk before anybody hears it."""
        if not self.guard.works and verb is not seen.Verb.STOP:
            return
        if verb is seen.Verb.STOP:
            self.disk_wanted = Wanted.DOWN
        self.guard.tell(seen.OperatorAsked(self.clock.now_ns, verb, "because"))

    def sleep(self, gap_ns: int) -> None:
        """The whole machine sleeps: nobody can do anything, the clock goes on."""
        self.clock.leap(gap_ns)
        life = self.core
        if life is not None:
            life.since_ns += gap_ns  # what befell it did not go on in its sleep
        if life is not None and life.condition is WELL:
            life.befall(STARVED, self.rng.randrange(150) * NS_PER_MS)
            self.worry()

    def stall_guard(self, for_ns: int) -> None:
        """The guard gets no processor time."""
        self.guard.awake_ns = self.clock.now_ns + for_ns

    def calm_down(self) -> None:
        """The quiet at the end: what the guard can't heal heals by itself, the rest is the guard's."""
        self.quiet = True
        self.boot_plans.clear()
        self.evidence.clear()
        self.slow_spawns_ns.clear()
        self.failing_spawns, self.tick_late_ns, self.orders_until_death = 0, 0, None
        for life in [life for life in self.lives if life.alive]:
            if life.in_kernel:
                if self.rng.random() < STUCK_FOR_EVER:
                    self.stuck_for_ever = True
                else:
                    life.let_go()
            life.extra_notes, life.extra_waiting = (), 0
            if self._nobody_heals(life.condition):
                life.befall(WELL)
        for number, wait_s in enumerate((0, 0, 60, 900)):
            self.clock.after(wait_s * NS_PER_S, partial(self._ask_for_service, number))

    def _nobody_heals(self, condition: Condition) -> bool:
        """Whether the guard may not call this a hang, or the policy does nothing about it."""
        if condition.judged is Judged.NEVER:
            return True
        names = {
            FROZEN: Diagnosis.FROZEN,
            WRITER_ASLEEP: Diagnosis.NO_PROGRESS,
            WRITER_GONE: Diagnosis.NO_PROGRESS,
        }
        diagnosis = names.get(condition, Diagnosis.LOOP_BLOCKED)
        return not self.policy.asks(diagnosis, Word.REBOOT_PROCESS)

    def _ask_for_service(self, number: int) -> None:
        self.gateway.submit(f"quiet-{number}")
        self.worry()
