"""The guarded side of the simulated machine: the ledger's store, and cores that live and die on it.

A core boots, fences, proves, serves, leaves or dies, as the plan of its boot and the conditions that befall
it say. Its beats are not events: they are computed when somebody looks, from when they stopped, so that a
core that is well costs nothing. Work that can't go on in a condition waits until it passes.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from random import Random
from typing import TYPE_CHECKING, Protocol

from hardcore.model import observations as seen
from hardcore.model.recorder import (
    Beats,
    CommandNote,
    LastWords,
    LifeState,
    Page,
    SlotStage,
    Threads,
    Witness,
)
from tests.simulation.clock import NS_PER_MS, Clock
from tests.simulation.conditions import FROZEN, WELL, Condition, ThreadLook

if TYPE_CHECKING:  # the workload knows the machine; the machine only hands its requests around
    from tests.simulation.workload import Request

BEAT_NS = 50 * NS_PER_MS
#: How long after READY the whole ledger is proven.
AUDIT_NS = 300 * NS_PER_MS
FENCED, LOCKED = 75, 69
#: Now and then nobody can read how a process ended.
STATUS_LOST = 0.02
#: What a death from inside makes suspect.
TOUCHED = frozenset({SlotStage.DECIDING, SlotStage.WRITING})
THREADS = Threads(loop=1, writer=2, beat=3)


class Harm(Enum):
    """What a poisonous command does to the core that decides it."""

    NONE = "none"
    CRASH = "crash"
    EXIT = "exit"
    BLOCK = "block"


class Stage(Enum):
    """How far a core has come."""

    BORN = "born"
    FENCED = "fenced"
    READY = "ready"
    DEAD = "dead"


@dataclass(slots=True)
class Store:
    """The ledger: an epoch that only grows, and each command at most once."""

    epoch: int = 3
    commits: list[tuple[int, int, str]] = field(default_factory=list)
    keys: dict[str, int] = field(default_factory=dict)

    def raise_epoch(self, expected: int | None) -> bool:
        """Compare and set."""
        if expected is not None and expected != self.epoch:
            return False
        self.epoch += 1
        return True

    def commit(self, epoch: int, life: int, key: str) -> bool:
        """Write one command, if `epoch` is still the one that may; the caller has looked the key up."""
        if epoch != self.epoch:
            return False
        assert key not in self.keys, f"{key} is written twice"
        self.commits.append((epoch, life, key))
        self.keys[key] = len(self.commits)
        return True


@dataclass(frozen=True, slots=True)
class BootPlan:
    """How a boot will go. `end`: how it ends there; None with `hangs`: never."""

    fence_ns: int
    prove_ns: int
    fails_at: Stage | None = None
    end: seen.Exit | None = None
    words: str = ""
    hangs: bool = False
    extends_ns: int = 0
    tells_epoch: bool = True


@dataclass(slots=True)
class Slot:
    """One command in a core."""

    request: "Request"
    started_ns: int
    stage: SlotStage = SlotStage.QUEUED
    stage_ns: int = 0

    def note(self) -> CommandNote:
        """As the recorder shows it."""
        request = self.request
        return CommandNote(
            self.stage, request.command_id, request.key_hash, request.kind, "", (),
            self.started_ns, stage_ns=self.stage_ns,
        )  # fmt: skip


class Surroundings(Protocol):
    """What a core needs of its world."""

    clock: Clock
    rng: Random
    store: Store

    def tell(self, life: "Life", fact: seen.Observation) -> None: ...
    def answered(self, life: "Life", request: "Request") -> None: ...
    def died(self, life: "Life") -> None: ...
    def worry(self) -> None: ...


class Life:
    """One core process. `number` is its guard's, `serial` the world's own: no two are alike."""

    def __init__(
        self, world: Surroundings, number: int, serial: int, expected: int | None, plan: BootPlan
    ) -> None:
        self.world = world
        self.number = number
        self.serial = serial
        self.guard = 0
        self.expected = expected
        self.plan = plan
        self.stage = Stage.BORN
        self.epoch: int | None = None
        self.condition = WELL
        self.since_ns = world.clock.now_ns
        self.stopped_by_guard = False
        self.slots: dict[str, Slot] = {}
        self.submitted = self.completed = self.completed_ns = 0
        self.witness: Witness | None = None
        self.words: LastWords | None = None
        self.exit: seen.Exit | None = None
        self.page_lost = False
        self.status_lost = world.rng.random() < STATUS_LOST
        self.ignores_term = False
        self.in_kernel = False  # a signal can't end it before the kernel lets it go
        self.kill_pending = False
        self.asked = False  # somebody wanted its end: its death is no accident of its own
        self.blamed = False  # the guard judged that it hung from inside
        self.completed_boot = False
        self.extra_waiting = 0
        self.extra_notes: tuple[CommandNote, ...] = ()
        self._phase_ns = world.rng.randrange(BEAT_NS)
        self._loop_silent_ns: int | None = None
        self._thread_silent_ns: int | None = None
        self._waiting: list[tuple[bool, Callable[[], None]]] = []
        self._spent_ns = 0
        self._turn = 0
        world.clock.after(plan.fence_ns, lambda: self.on_loop(self._fence))
        if plan.extends_ns:
            world.clock.after(plan.fence_ns // 2, lambda: self.on_loop(self._extend))

    @property
    def alive(self) -> bool:
        """Whether there is a process."""
        return self.stage is not Stage.DEAD

    @property
    def inside(self) -> bool:
        """The truth that the guard has to guess: did this end come from inside?"""
        if self.asked and not self.blamed:
            return False
        how = self.exit
        own_signal = how is not None and how.signal in {4, 6, 7, 8, 11}
        own_code = how is not None and how.code in {0, 1} and self.completed_boot
        return self.blamed or own_signal or own_code

    @property
    def taken(self) -> bool:
        """Whether the writer is in the middle of a command."""
        return any(slot.stage in TOUCHED for slot in self.slots.values())

    # ---- work, and what keeps it waiting ----

    def on_loop(self, work: Callable[[], None]) -> None:
        """Do what the event loop does, now or when it turns again."""
        if self.alive:
            if self.condition.loop_works:
                work()
            else:
                self._waiting.append((True, work))

    def on_writer(self, work: Callable[[], None]) -> None:
        """Do what the writer's thread does, now or when it can again."""
        if self.alive:
            if self.condition.writer_works:
                work()
            else:
                self._waiting.append((False, work))

    def befall(self, condition: Condition, for_ns: int | None = None) -> None:
        """Let a condition begin; it ends after `for_ns`, or never by itself."""
        if not self.alive or condition is self.condition:
            return
        now_ns = self.world.clock.now_ns
        self._turn += 1
        self.condition, self.since_ns = condition, now_ns
        self._loop_silent_ns = None if condition.loop_beats else self._loop_silent_ns or now_ns
        self._thread_silent_ns = None if condition.thread_beats else self._thread_silent_ns or now_ns
        if for_ns is not None:
            turn = self._turn
            self.world.clock.after(for_ns, lambda: self._pass(turn))
        ready = [w for on_loop, w in self._waiting if self._works(on_loop)]
        self._waiting = [(on_loop, w) for on_loop, w in self._waiting if not self._works(on_loop)]
        for work in ready:
            if self.alive:
                work()

    def _pass(self, turn: int) -> None:
        if self._turn == turn:
            self.befall(WELL)

    def _works(self, on_loop: bool) -> bool:
        return self.condition.loop_works if on_loop else self.condition.writer_works

    # ---- boot ----

    def _extend(self) -> None:
        self._tell(seen.StartExtended(self.world.clock.now_ns, self.number, self.plan.extends_ns))

    def _fence(self) -> None:
        plan, store = self.plan, self.world.store
        if plan.fails_at is Stage.BORN:
            self._fail()
        elif not store.raise_epoch(self.expected):
            self.die(seen.Exit(code=FENCED), "FENCED")
        else:
            self.epoch, self.stage = store.epoch, Stage.FENCED
            if plan.tells_epoch:
                self._tell(seen.EpochRaised(self.world.clock.now_ns, self.number, store.epoch))
            self.world.clock.after(plan.prove_ns, lambda: self.on_loop(self._prove))

    def _prove(self) -> None:
        if self.plan.fails_at is Stage.FENCED:
            self._fail()
            return
        assert self.epoch is not None, "a core proves after its fence"
        self.stage, self.completed_boot = Stage.READY, True
        seq = len(self.world.store.commits)
        proof = seen.Proof("chain" if self.expected is None else "witness", 0, seq, f"{seq:x}")
        self._tell(seen.CoreReady(self.world.clock.now_ns, self.number, self.epoch, proof))
        self.world.clock.after(AUDIT_NS, lambda: self.on_loop(lambda: self._audited(seq)))

    def _audited(self, seq: int) -> None:
        """The whole ledger was looked at behind the serving; every fifth length of it is found not to be whole."""
        if self.stage is Stage.READY:
            fault = "not whole" if seq % 5 == 4 else ""
            fact = seen.LedgerAudited(self.world.clock.now_ns, self.number, None if fault else seq, fault)
            self._tell(fact)

    def _fail(self) -> None:
        if self.plan.hangs:
            return
        assert self.plan.end is not None, "a boot that fails ends or hangs"
        if self.plan.end.code == LOCKED:
            self._tell(seen.FenceBlocked(self.world.clock.now_ns, self.number))
        self.die(self.plan.end, self.plan.words)

    def _tell(self, fact: seen.Observation) -> None:
        self.world.tell(self, fact)

    # ---- commands ----

    def accept(self, request: "Request") -> None:
        """Take a command in: from here on it is on the recorder."""
        now_ns = self.world.clock.now_ns
        self.slots[request.command_id] = Slot(request, now_ns, stage_ns=now_ns)
        self.submitted += 1
        self._later(2, lambda: self.on_writer(lambda: self._decide(request)))

    def _later(self, most_ms: int, work: Callable[[], None]) -> None:
        self.world.clock.after(self.world.rng.randrange(most_ms * NS_PER_MS), work)

    def _reach(self, request: "Request", stage: SlotStage) -> None:
        slot = self.slots[request.command_id]
        slot.stage, slot.stage_ns = stage, self.world.clock.now_ns

    def _decide(self, request: "Request") -> None:
        self._reach(request, SlotStage.DECIDING)
        request.decided(self)
        if not self.alive or request.harm is Harm.BLOCK:
            return
        if request.key in self.world.store.keys:
            self._answer_soon(request)
        else:
            self._later(4, lambda: self.on_writer(lambda: self._write(request)))

    def _write(self, request: "Request") -> None:
        self._reach(request, SlotStage.WRITING)
        self._later(8, lambda: self.on_writer(lambda: self._commit(request)))

    def _commit(self, request: "Request") -> None:
        assert self.epoch is not None, "only a core that has fenced takes commands"
        store = self.world.store
        if request.key not in store.keys:  # the same key may have been on its way twice
            if not store.commit(self.epoch, self.serial, request.key):
                self.die(seen.Exit(code=FENCED), "FENCED")
                return
            seq = len(store.commits)
            self.witness = Witness(seq, self.epoch, f"{seq:x}", self.world.clock.now_ns)
        self._reach(request, SlotStage.COMMITTED)
        self._answer_soon(request)

    def _answer_soon(self, request: "Request") -> None:
        self._later(2, lambda: self.on_loop(lambda: self._answer(request)))

    def _answer(self, request: "Request") -> None:
        del self.slots[request.command_id]
        self.completed += 1
        self.completed_ns = self.world.clock.now_ns
        self.world.answered(self, request)

    # ---- the end ----

    def signal(self, number: int) -> None:
        """Send it a signal that ends it."""
        if self.in_kernel:
            self.kill_pending = self.kill_pending or number == 9
        else:
            self.die(seen.Exit(signal=number))

    def terminate(self, by_guard: bool = True) -> None:
        """Ask it to leave."""
        self.asked = True
        if self.condition is FROZEN and by_guard:
            self.befall(WELL)  # the guard sends CONT with it
        if self.stage is Stage.BORN:
            self.signal(15)
        elif not self.ignores_term:
            if not by_guard:
                self._tell(seen.TermReceived(self.world.clock.now_ns, self.number, 4711))
            self._later(300, lambda: self.on_loop(lambda: self.die(seen.Exit(code=0))))

    def let_go(self) -> None:
        """The kernel lets it go: a signal that waited takes effect."""
        self.in_kernel = False
        if self.kill_pending:
            self.die(seen.Exit(signal=9))

    def die(self, how: seen.Exit, words: str = "") -> None:
        """End."""
        if not self.alive:
            return
        if words:
            self.words = LastWords(self.world.clock.now_ns, words, "as planned")
        self.exit, self.stage = how, Stage.DEAD
        self.world.died(self)

    # ---- what a look from outside finds ----

    def beats(self) -> Beats:
        """The beat block now."""
        now_ns = self.world.clock.now_ns
        loop_ns = self._beat(self._loop_silent_ns, now_ns)
        thread_ns = self._beat(self._thread_silent_ns, now_ns)
        in_store = self.since_ns if self.condition.in_store and self.slots else 0
        return Beats(
            loop_ns, loop_ns // BEAT_NS, thread_ns, thread_ns // BEAT_NS,
            self.submitted + self.extra_waiting, self.completed, self.completed_ns,
            in_store, 0, self.epoch or 0, LifeState.READY,
        )  # fmt: skip

    def _beat(self, silent_ns: int | None, now_ns: int) -> int:
        last_ns = now_ns if silent_ns is None else min(now_ns, silent_ns)
        return last_ns - (last_ns - self._phase_ns) % BEAT_NS

    def sample(self, tick_ns: int, *, closer: bool) -> seen.ProcessSample:
        """The process as the kernel shows it; threads only when somebody looks closer."""
        row = self.condition
        self._spent_ns += 0 if row.quiet else tick_ns // 2
        loop = self._thread(row.loop) if closer else None
        writer = self._thread(row.writer) if closer else None
        return seen.ProcessSample(row.state, self._spent_ns, 61 << 20, 4, None, loop, writer)

    def _thread(self, look: ThreadLook) -> seen.ThreadSample:
        spent_ns = self.world.clock.now_ns if look.burns else 5
        return seen.ThreadSample(look.state, spent_ns, look.waits_in)

    def notes(self) -> tuple[CommandNote, ...]:
        """The commands in flight."""
        return (*(slot.note() for slot in self.slots.values()), *self.extra_notes)

    def page(self) -> Page | None:
        """The whole recorder page."""
        if self.page_lost:
            return None
        return Page(
            f"{self.serial:016x}", "boot", 1000 + self.serial, 1, THREADS, self.beats(), self.witness,
            self.words, self.notes(), (), (),
        )  # fmt: skip
