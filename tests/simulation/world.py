"""The simulated machine: one clock, one store, cores, a gateway with clients, and the guard of the moment.

The world owns what outlives any process (the store, what a guard wrote to disk, the operator's word) and
the switches that faults turn. What it knows is the truth; the guard inside only hears what it would hear.
"""

from random import Random

from msgspec.structs import replace

from hardcore.model import observations as seen
from hardcore.model.phases import Wanted
from hardcore.model.trials import CourtMemory, Letter
from hardcore.model.verdicts import Diagnosis
from hardcore.quarantine_file import Aside
from hardcore.recovery.policy import Policy
from tests.simulation.checkers import Checkers
from tests.simulation.clock import NS_PER_MS, Clock
from tests.simulation.conditions import WELL, Condition
from tests.simulation.guard import Guard
from tests.simulation.looks import Spoilt, notes, page
from tests.simulation.machine import TOUCHED, Life, Stage
from tests.simulation.store import REFUSALS, Disk, Rot, Store
from tests.simulation.switches import Looking, Switches
from tests.simulation.workload import Gateway, Request

#: How often nobody may look at stacks, and how often a look never comes back.
DENIED, NEVER = 0.15, 0.1
#: Memory for a spare, and to spare.
FREE_BYTES = 8 << 30
#: For so long nobody watched, as the next guard is told; how long it was does not decide anything.
UNWATCHED_NS = NS_PER_MS


class World:
    """See the module."""

    def __init__(self, seed: int, policy: Policy, *, warm: bool = False) -> None:
        self.warm = warm
        self.free_bytes = FREE_BYTES
        self.build = "b1"
        self.bad_builds: set[str] = set()
        self.clock = Clock()
        self.rng = Random(seed)
        self.policy = policy
        self.store = Store()
        self.lives: list[Life] = []
        self.guards: list[Guard] = []
        self.quiet = False
        self.stranger_raised = False
        self.stuck_for_ever = False
        self.held_into_the_quiet = False
        self.disk_wanted = Wanted.UP
        self.disk_deaths_ns: tuple[int, ...] = ()
        self.disk_shut: Diagnosis | None = None
        self.disk_court: CourtMemory | None = None
        self.cases: dict[str, Request] = {}  # on the disk
        self.aside = Aside()  # the rules on the disk
        self.letters: dict[str, Letter] = {}  # whose rules were ever written, by their numbers
        self.slowed: set[str] = set()  # whom a trial found slow for no fault of theirs
        self.slept_ns = self.wall_shift_ns = 0
        self.truths: dict[Diagnosis, int] = {}
        self.spoilt = Spoilt()
        self.switches = Switches(self.rng)
        dice = self.rng.random()
        if dice < DENIED + NEVER:
            self.switches.looking = Looking.DENIED if dice < DENIED else Looking.NEVER
        self.checkers = Checkers(self)
        self.gateway = Gateway(self)

    @property
    def set_aside(self) -> frozenset[str]:
        """Whose requests the rules on the disk refuse."""
        return frozenset(str(rule["name"]) for rule in self.aside.rules if rule["type"] == "letter")

    # ---- who is there ----

    @property
    def guard(self) -> Guard:
        """The sentinel of the moment (or the last one)."""
        return self.guards[-1]

    @property
    def core(self) -> Life | None:
        """The living core, if there is one: no spare, and nobody who was left behind."""
        return next((x for x in reversed(self.lives) if x.alive and not x.waits and not x.drained), None)

    @property
    def spare(self) -> Life | None:
        """The spare that waits or warms up, if there is one."""
        return next((life for life in reversed(self.lives) if life.alive and life.waits), None)

    def begin_guard(self) -> None:
        """A sentinel starts, with what its predecessor left on disk and in the process table."""
        before = self.guards[-1] if self.guards else None
        guard = Guard(self, len(self.guards) + 1, self.policy, self.disk_wanted, self.disk_deaths_ns)
        self.guards.append(guard)
        self.checkers.began(guard)
        if before is not None and (before.halted or not self.warm):
            self.gateway.renewed()
        pages = [left for life in self.lives if (left := page(life)) is not None and left.witness]
        last = max(pages, key=lambda left: left.witness.seq if left.witness else 0, default=None)
        adopts = self.warm and self.disk_wanted is not Wanted.DOWN
        found = self._adoptable(before) if before is not None and adopts else None
        others = any(life.alive and life is not found for life in self.lives)
        guard.adopts = found
        own = page(found) if found is not None else None
        suspects = self._suspected(before) if before is not None and self.warm else ()
        since_ns = found.served_ns if found is not None else None
        memory = guard.courtroom.take_up(self.disk_court)
        lost = before is not None and not before.halted
        began = seen.SentinelBegan(
            self.clock.now_ns,
            others,
            last,
            own,
            suspects,
            since_ns,
            memory,
            unwatched_ns=UNWATCHED_NS if lost else None,
            shut=self.disk_shut,
        )
        guard.hear(began)

    def _adoptable(self, before: Guard) -> Life | None:
        """The core that serves under the highest epoch of all pages, and that nobody had begun to end."""
        highest = max((life.epoch or 0 for life in self.lives if not life.page_lost), default=0)
        for life in self.lives:
            serves = life.stage is Stage.READY and life.epoch == highest and not life.draining
            wished = life.safe and self.disk_wanted is Wanted.SAFE
            sound = not (life.page_lost or life.unfenced) and (wished or not life.safe)
            if serves and sound and life.serial not in before.condemned:
                return life
        return None

    def _suspected(self, before: Guard) -> tuple[str, ...]:
        """What stands in the incident that the earlier guard left open, and in the page of the last core it released."""
        story = before.manager.open_incident()
        last = self.gateway.serving
        over = last is not None and (not last.alive or last.serial in before.condemned) and not last.page_lost
        touched = [n for n in notes(last) if n.stage in TOUCHED] if last is not None and over else []
        return (*(story.suspects if story else ()), *(note.key_hash for note in touched if note.key_hash))

    def kill_guard(self) -> None:
        """The sentinel dies; somebody starts another."""
        guard = self.guard
        if not guard.works:
            return
        guard.alive = False
        self.switches.orders_until_death = None
        for spare in guard.lose_spawns():
            if self.rng.random() < 0.5:
                self.make_life(0, None, spare=spare)
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

    def make_life(
        self, number: int, expected: int | None, safe: Diagnosis | None = None, *, spare: bool = False
    ) -> Life:
        """A core process begins; one that reads only has no fence at which it could fail."""
        plan = self.switches.spare_plan() if spare else self.switches.boot_plan(prepared=safe is None)
        if self.build in self.bad_builds:
            at = Stage.WARM if spare else Stage.BORN
            plan = replace(plan, fails_at=at, end=seen.Exit(code=1), words="", hangs=False)
        life = Life(self, number, len(self.lives) + 1, expected, plan, safe, spare)
        life.guard = self.guard.number
        self.lives.append(life)
        return life

    # ---- what cores tell ----

    def tell(self, life: Life, fact: seen.Observation) -> None:
        """A core's datagram: it reaches the guard that started it, and no other."""
        if life.guard == self.guard.number:
            self.guard.tell(fact)

    def to_guard(self, fact: seen.Observation) -> None:
        """A fact from the gateway."""
        self.guard.tell(fact)

    def answered(
        self, life: Life, request: Request, *, refused: bool = False, postponed: bool = False
    ) -> None:
        """A core answers; `refused`: that it did nothing; `postponed`: that it is drained and has not run it."""
        if postponed:
            self.gateway.postponed(life, request)
        elif refused:
            self.gateway.refused(life, request)
        else:
            self.gateway.answered(life, request)

    def died(self, life: Life) -> None:
        """A core is gone."""
        self.gateway.died(life)
        if self.store.holder is not None and self.store.holder.pid == 1000 + life.serial:
            self.store.befall(self.clock.now_ns, self.store.disk)
        if self.guard.works:
            self.guard.died(life)

    @property
    def unseen_until_ns(self) -> int:
        """Until when something of a core can't be seen that could be."""
        return max(self.spoilt.until_ns, self.switches.unseen_until_ns)

    def worry(self) -> None:
        """Something is the matter: the guard's ticks matter from now on."""
        if self.guard.works:
            self.guard.watch()

    # ---- what faults do ----

    def is_true(self, diagnosis: Diagnosis) -> None:
        """Remember that this was the matter just now."""
        self.truths[diagnosis] = self.clock.now_ns

    def note_truths(self) -> None:
        """Remember what is the matter with the store at this moment."""
        store = self.store
        if store.disk in REFUSALS:
            self.is_true(REFUSALS[store.disk][1])
        elif store.disk is Disk.STALLED:
            self.is_true(Diagnosis.DISK_STALLED)
        if store.holder is not None:
            self.is_true(Diagnosis.DB_LOCKED)
        if any(life.alive and life.part_stalled_ns for life in self.lives):
            self.is_true(Diagnosis.COMPONENT_STALLED)
        if store.rot is not Rot.NONE:
            self.is_true(Diagnosis.STORE_CORRUPT)

    def befall(self, condition: Condition, for_ns: int | None = None) -> None:
        """Something befalls the living core, between two ticks of the watch."""
        life = self.core
        if life is not None and life.condition is WELL:
            self.worry()

            self.clock.after(
                self.rng.randrange(100) * NS_PER_MS, lambda: self._begin(life, condition, for_ns)
            )

    def _begin(self, life: Life, condition: Condition, for_ns: int | None) -> None:
        if self.quiet or not life.alive or life.condition is not WELL:
            return  # something else came first
        if condition.loop_works and not condition.writer_works and (life.taken or life.in_store_ns):
            # What the writer has in its hands is said by the condition: it begins between two commands.
            self.clock.after(3 * NS_PER_MS, lambda: self._begin(life, condition, for_ns))
            return
        life.befall(condition, for_ns)
