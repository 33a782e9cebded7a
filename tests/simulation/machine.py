"""The guarded side of the simulated machine: cores that live and die on the ledger's store.

A core boots, fences, proves, serves, leaves or dies, as the plan of its boot and the conditions that befall
it say. Work that can't go on in a condition waits until it passes; work that the store keeps waiting (a stalled
disk, another program's lock) waits there. What somebody outside sees of a core is in `looks.py`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from random import Random
from typing import TYPE_CHECKING, Protocol

import msgspec

from hardcore.model import observations as seen
from hardcore.model.actions import Promote, SetSafe
from hardcore.model.recorder import CommandNote, LastWords, SlotStage, Witness
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.policy import Policy
from tests.simulation.clock import NS_PER_MS, Clock
from tests.simulation.conditions import FROZEN, WELL, Condition
from tests.simulation.harms import Harm
from tests.simulation.store import REFUSALS, Disk, Rot, Store

if TYPE_CHECKING:  # the workload knows the machine; the machine only hands its requests around
    from tests.simulation.workload import Request

#: How long after READY the whole ledger is proven.
AUDIT_NS = 300 * NS_PER_MS
CORRUPT, LOCKED, NO_ROOM, COMMIT_FAILED, FENCED = 65, 69, 73, 74, 75
#: How long a core waits at its fence for a lock that somebody else holds.
FENCE_BUSY_NS = 2_000 * NS_PER_MS
#: A resident memory that nothing is wrong with.
RSS_BYTES = 61 << 20
#: Now and then nobody can read how a process ended.
STATUS_LOST = 0.02
#: What a death from inside makes suspect.
TOUCHED = frozenset({SlotStage.DECIDING, SlotStage.WRITING})


class Stage(Enum):
    """How far a core has come."""

    BORN = "born"
    WARM = "warm"  # a spare that waits
    FENCED = "fenced"
    READY = "ready"
    DEAD = "dead"


class BootPlan(msgspec.Struct, frozen=True):
    """How a boot will go. `end`: how it ends there; None with `hangs`: never."""

    fence_ns: int
    prove_ns: int
    fails_at: Stage | None = None
    end: seen.Exit | None = None
    words: str = ""
    hangs: bool = False
    extends_ns: int = 0
    refuses: bool = False  # a spare that does not take over
    tells_epoch: bool = True


@dataclass(slots=True)
class Slot:
    """One command in a core."""

    request: "Request"
    started_ns: int
    stage: SlotStage = SlotStage.QUEUED
    stage_ns: int = 0

    def note(self, limit_ns: int) -> CommandNote:
        """As the recorder shows it."""
        request = self.request
        return CommandNote(
            self.stage, request.command_id, request.key_hash, request.kind, "", (),
            self.started_ns, limit_ns, self.stage_ns,
        )  # fmt: skip


class Surroundings(Protocol):
    """What a core needs of its world."""

    clock: Clock
    rng: Random
    store: Store
    policy: Policy

    @property
    def build(self) -> str: ...
    @property
    def unseen_until_ns(self) -> int: ...

    def tell(self, life: "Life", fact: seen.Observation) -> None: ...
    def is_true(self, diagnosis: Diagnosis) -> None: ...
    def answered(
        self, life: "Life", request: "Request", *, refused: bool = False, postponed: bool = False
    ) -> None: ...
    def died(self, life: "Life") -> None: ...
    def worry(self) -> None: ...


class Life:
    """One core process. `number` is its guard's, `serial` the world's own: no two are alike."""

    def __init__(
        self,
        world: Surroundings,
        number: int,
        serial: int,
        expected: int | None,
        plan: BootPlan,
        safe: Diagnosis | None = None,
        spare: bool = False,
    ) -> None:
        self.world = world
        self.spare = spare
        self.waits = spare  # it was not told to take over yet
        self.build = world.build
        self.witnesses: tuple[Witness, ...] = ()
        self.busy_ns = FENCE_BUSY_NS
        self.draining = self.drained = False
        self.number = number
        self.serial = serial
        self.guard = 0
        self.expected = expected
        self.plan = plan
        self.stage = Stage.BORN
        self.epoch: int | None = None
        self.condition = WELL
        self.since_ns = self.began_ns = world.clock.now_ns
        self.slots: dict[str, Slot] = {}
        self.submitted = self.completed = self.completed_ns = 0
        self.witness: Witness | None = None
        self.words: LastWords | None = None
        self.exit: seen.Exit | None = None
        self.page_lost = False
        self.part_stalled_ns = 0  # since when one of its parts stands still
        self.status_lost = world.rng.random() < STATUS_LOST
        self.ignores_term = False
        self.in_kernel = False  # a signal can't end it before the kernel lets it go
        self.kill_pending = False
        self.asked = False  # somebody wanted its end: its death is no accident of its own
        self.blamed = False  # the guard judged that it hung from inside
        self.completed_boot, self.served_ns = False, 0
        self.extra_waiting = 0
        self.extra_notes: tuple[CommandNote, ...] = ()
        self.unfenced = safe is not None  # it reads only, for ever
        self.safe = safe is not None
        self.claimed_seq = 0
        self.in_store_ns = 0
        self.rss_bytes = RSS_BYTES
        self.oom_kills = 0
        self.loop_silent_ns: int | None = None
        self.thread_silent_ns: int | None = None
        self._waiting: list[tuple[bool, Callable[[], None]]] = []
        self._turn = 0
        world.clock.after(plan.fence_ns, lambda: self.on_loop(self._warm if spare else self._fence))
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
            if self._works(on_loop=False):
                work()
            else:
                self._waiting.append((False, work))

    def pause(self, gap_ns: int) -> None:
        """Nothing went on for so long: what befell it has lasted for less than a clock says."""
        self.since_ns += gap_ns

    def befall(self, condition: Condition, for_ns: int | None = None) -> None:
        """Let a condition begin; it ends after `for_ns`, or never by itself."""
        if not self.alive or condition is self.condition:
            return
        now_ns = self.world.clock.now_ns
        self._turn += 1
        self.condition, self.since_ns, self.began_ns = condition, now_ns, now_ns
        self.loop_silent_ns = None if condition.loop_beats else self.loop_silent_ns or now_ns
        self.thread_silent_ns = None if condition.thread_beats else self.thread_silent_ns or now_ns
        if for_ns is not None:
            turn = self._turn
            self.world.clock.after(for_ns, lambda: self._pass(turn))
        self._go_on()

    def _go_on(self) -> None:
        ready = [w for on_loop, w in self._waiting if self._works(on_loop)]
        self._waiting = [(on_loop, w) for on_loop, w in self._waiting if not self._works(on_loop)]
        for work in ready:
            if self.alive:
                work()

    def _pass(self, turn: int) -> None:
        if self._turn == turn:
            self.befall(WELL)

    def _works(self, on_loop: bool) -> bool:
        if on_loop:
            return self.condition.loop_works
        return self.condition.writer_works and not self.in_store_ns

    # ---- boot ----

    def _extend(self) -> None:
        self._tell(seen.StartExtended(self.world.clock.now_ns, self.number, self.plan.extends_ns))

    def _warm(self) -> None:
        """A spare has loaded all it needs, and waits."""
        if self.plan.fails_at is Stage.WARM:
            self._fail()
        elif self.stage is Stage.BORN:
            self.stage = Stage.WARM
            self._tell(seen.SpareReady(self.world.clock.now_ns, self.number, self.build, 4))

    def promote(self, order: Promote) -> None:
        """Take over, unless it can't."""
        if self.plan.refuses or self.stage is not Stage.WARM:
            self._tell(seen.PromoteRefused(self.world.clock.now_ns, self.number, "no"))
            return
        self.stage, self.waits = Stage.BORN, False
        self.expected, self.witnesses = order.expected_epoch, order.witnesses
        self.busy_ns = FENCE_BUSY_NS if order.busy_ms is None else order.busy_ms * NS_PER_MS
        self._later(20, lambda: self.on_loop(self._fence))

    def _fence(self) -> None:
        plan, store = self.plan, self.world.store
        if self.unfenced:
            self.epoch = store.epoch
            self.world.clock.after(plan.prove_ns, lambda: self.on_loop(self._prove))
        elif plan.fails_at is Stage.BORN:
            self._fail()
        elif store.holder is not None:
            store.waiting.append(lambda: self.on_loop(self._fence))
            self.world.clock.after(self.busy_ns, lambda: self.on_loop(self._locked_out))
        elif store.disk is Disk.STALLED:
            store.waiting.append(lambda: self.on_loop(self._fence))
        elif store.disk in REFUSALS:
            self.world.is_true(Diagnosis.DISK_FULL)  # at the fence it is all one to the core
            self.die(seen.Exit(code=NO_ROOM), "DISK_FULL")
        elif not store.raise_epoch(self.expected):
            self.die(seen.Exit(code=FENCED), "FENCED")
        else:
            self.epoch, self.stage = store.epoch, Stage.FENCED
            if plan.tells_epoch:
                self._tell(seen.EpochRaised(self.world.clock.now_ns, self.number, store.epoch))
            self.world.clock.after(plan.prove_ns, lambda: self.on_loop(self._prove))

    def _locked_out(self) -> None:
        """Somebody else has held the lock for longer than it waits."""
        if self.stage is Stage.BORN and self.world.store.holder is not None:
            self._tell(seen.FenceBlocked(self.world.clock.now_ns, self.number))
            self.die(seen.Exit(code=LOCKED), "DB_LOCKED")

    def _prove(self) -> None:
        if self.plan.fails_at is Stage.FENCED and not self.unfenced:
            self._fail()
            return
        if self.world.store.kills and not self.unfenced:
            self.die(seen.Exit(signal=11))
            return
        if self.world.store.rot is Rot.HEAD and not self.unfenced:
            self.die(seen.Exit(code=CORRUPT), "STORE_CORRUPT")
            return
        if any(witness.seq > len(self.world.store.commits) for witness in self.witnesses):
            self.die(seen.Exit(code=CORRUPT), "STORE_CORRUPT")
            return
        assert self.epoch is not None, "a core proves after its fence"
        self.stage, self.completed_boot, self.served_ns = Stage.READY, True, self.world.clock.now_ns
        seq = len(self.world.store.commits)
        kind = "none" if self.unfenced else "chain" if self.expected is None else "witness"
        proof = seen.Proof(kind, 0, seq, f"{seq:x}")
        self._tell(seen.CoreReady(self.world.clock.now_ns, self.number, self.epoch, proof))
        self.world.clock.after(AUDIT_NS, lambda: self.on_loop(lambda: self._audited(seq)))

    def _audited(self, seq: int) -> None:
        """The whole ledger was looked at behind the serving."""
        if self.stage is Stage.READY:
            fault = "" if self.world.store.rot is Rot.NONE else "event 3: the sums are not zero"
            fact = seen.LedgerAudited(self.world.clock.now_ns, self.number, None if fault else seq, fault)
            self._tell(fact)

    def _fail(self) -> None:
        if self.plan.hangs:
            return
        assert self.plan.end is not None, "a boot that fails ends or hangs"
        if self.plan.end.code == LOCKED:
            self._tell(seen.FenceBlocked(self.world.clock.now_ns, self.number))
        if self.plan.words in Diagnosis.__members__:
            self.world.is_true(Diagnosis(self.plan.words))
        self.die(self.plan.end, self.plan.words)

    def _tell(self, fact: seen.Observation) -> None:
        self.world.tell(self, fact)

    # ---- commands ----

    def accept(self, request: "Request") -> None:
        """Take a command in: from here on it is on the recorder. One that reads only refuses it at the door."""
        if self.safe:
            self.world.answered(self, request, refused=True)
            return
        if self.draining:
            self.world.answered(self, request, postponed=True)
            return
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
        request.written(self)
        if not self.alive:
            return
        if self.condition.lies:
            request.lied_to = True
            self.claimed_seq = max(self.claimed_seq, len(self.world.store.commits)) + 1
            self._answer_soon(request)
            return
        self._later(8, lambda: self.on_writer(lambda: self._commit(request)))

    def _commit(self, request: "Request") -> None:
        assert self.epoch is not None, "only a core that has fenced takes commands"
        store = self.world.store
        assert not self.unfenced, "a core without a fence writes nothing"
        assert not self.drained, "a core that has let go of the store writes nothing"
        if store.blocked:
            self.in_store_ns = self.in_store_ns or self.world.clock.now_ns
            for slot in self.slots.values():  # one writer: what it had decided is in this batch
                if slot.stage is SlotStage.DECIDING:
                    self._reach(slot.request, SlotStage.WRITING)
            store.waiting.append(lambda: self._comes_back(request))
            self.world.worry()
            return
        if store.disk in REFUSALS:
            self._refuse(request, store.disk)
            return
        if request.key not in store.keys:  # the same key may have been on its way twice
            if not store.commit(self.epoch, self.serial, request.key):
                self.die(seen.Exit(code=FENCED), "FENCED")
                return
            seq = len(store.commits)
            self.witness = Witness(seq, self.epoch, f"{seq:x}", self.world.clock.now_ns)
        self._reach(request, SlotStage.COMMITTED)
        self._answer_soon(request)

    def _comes_back(self, request: "Request") -> None:
        """The store answers: what waited in it goes on, and what waited behind it."""
        if self.alive:
            self.in_store_ns = 0
            self.on_writer(lambda: self._commit(request))
            self._go_on()

    def _refuse(self, request: "Request", disk: Disk) -> None:
        """The store took no write: nothing was done, and from now on nothing is tried."""
        self.safe = True
        self._tell(seen.StoreTold(self.world.clock.now_ns, self.number, REFUSALS[disk][0]))
        del self.slots[request.command_id]
        self.completed += 1
        self.world.answered(self, request, refused=True)
        self.world.worry()

    def set_safe(self, order: SetSafe) -> None:
        """Obey an order to read only, or to write again, which is tried first."""
        store, now_ns = self.world.store, self.world.clock.now_ns
        if not order.on and store.blocked:
            store.waiting.append(lambda: self.on_loop(lambda: self.set_safe(order)))
            return
        refused = not order.on and (self.unfenced or store.disk in REFUSALS)
        if not refused:
            self.safe = order.on
        self._tell(seen.SafeSwitched(now_ns, self.number, order.on, not refused, "no" if refused else ""))
        if not refused and not order.on:
            self._tell(seen.StoreTold(now_ns, self.number, seen.StoreFault.OK))

    def drain(self, within_ns: int) -> None:
        """Finish what it has, take nothing new; not within that time: go on."""
        if self.stage is not Stage.READY or self.draining:
            return
        self.draining = True
        give_up_ns = self.world.clock.now_ns + within_ns

        def look() -> None:
            now_ns = self.world.clock.now_ns
            if not self.draining:
                return
            if not self.slots:
                self.drained = True
                self._tell(seen.Drained(now_ns, self.number, True, len(self.world.store.commits)))
            elif now_ns >= give_up_ns:
                self._give_up_draining(f"{len(self.slots)} commands are under way")
            else:
                self.world.clock.after(20 * NS_PER_MS, lambda: self.on_loop(look))

        self._later(4, lambda: self.on_loop(look))

    def _give_up_draining(self, why: str) -> None:
        """Take requests again, and say so."""
        self.draining = False
        self._tell(seen.Drained(self.world.clock.now_ns, self.number, False, 0, why))

    def _answer_soon(self, request: "Request") -> None:
        self._later(2, lambda: self.on_loop(lambda: self._answer(request)))

    def _answer(self, request: "Request") -> None:
        del self.slots[request.command_id]
        request.finished(self)
        self.completed += 1
        self.completed_ns = self.world.clock.now_ns
        if not request.lied_to:
            self.claimed_seq = max(self.claimed_seq, self.witness.seq if self.witness else 0)
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
        if self.stage in {Stage.BORN, Stage.WARM}:
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
