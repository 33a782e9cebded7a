"""Weighs what the witnesses say.

Two different kinds of evidence must agree before a living process is called lost: what the core wrote about
itself (beats, queue, stages) and what others say of it (the kernel, the stacks, our own disk). One kind alone
is yellow. Both must have lasted: a core that was busy for long and then slept for a moment is not blocked.
So a busy core, a long garbage collection, a core that the machine does not schedule and a guard that was
itself asleep all stay alive.

The diagnoses are asked in the order of `TABLE`, and the first that speaks is right: what explains a silence from
outside the core comes before what blames it, what is named by two looks at the stacks before what is inferred,
and what ends nobody (a full disk) behind what a full disk does not explain.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import assert_never

from hardcore.model.observations import (
    Probed,
    ProcessSample,
    Sampled,
    StacksSampled,
    StoreLooked,
    StoreTold,
    Surveyed,
)
from hardcore.model.recorder import Beats, SlotStage
from hardcore.model.verdicts import GREEN, Colour, Diagnosis, Testimony, Verdict
from hardcore.sentinel.diagnoses import (
    db_locked,
    deadlock,
    disk_full,
    disk_read_only,
    disk_stalled,
    frozen,
    gil_held,
    loop_blocked,
    no_progress,
    slept,
    spinning,
    starved,
    transaction_timeout,
)
from hardcore.sentinel.look import Look
from hardcore.sentinel.patience import Patience
from hardcore.sentinel.wishes import Wishes
from hardcore.sentinel.witnesses import (
    answers,
    clocks,
    collection,
    conduct,
    disk,
    memory,
    own_stall,
    probe,
    process_state,
    processor,
    progress,
    resources,
    stacks,
    store,
    transactions,
)
from hardcore.sentinel.witnesses import beats as beat_witness

__all__ = ["Bench", "Patience"]

_NS_PER_MS = 1_000_000

#: Who is asked, in this order; the first that speaks is right.
TABLE: tuple[tuple[Diagnosis, Callable[[Look, Patience], Verdict | None]], ...] = (
    (Diagnosis.FROZEN, frozen.judge),
    (Diagnosis.DISK_STALLED, disk_stalled.judge),
    (Diagnosis.DEADLOCK, deadlock.judge),
    (Diagnosis.GIL_HELD, gil_held.judge),
    (Diagnosis.SPINNING, spinning.judge),
    (Diagnosis.LOOP_BLOCKED, loop_blocked.judge),
    (Diagnosis.DB_LOCKED, db_locked.judge),
    (Diagnosis.TRANSACTION_TIMEOUT, transaction_timeout.judge),
    # A disk that refuses explains no silence: whoever is told of it at once goes on reading.
    (Diagnosis.NO_PROGRESS, no_progress.judge),
    (Diagnosis.DISK_READ_ONLY, disk_read_only.judge),
    (Diagnosis.DISK_FULL, disk_full.judge),
    (Diagnosis.SLEPT, slept.judge),
    (Diagnosis.STARVED, starved.judge),
)


@dataclass(slots=True)
class Bench:
    """The witnesses of one life, and their judge.

    Made anew for each core: nothing that was held against one may be held against its successor.
    """

    patience: Patience
    _own_stall: own_stall.OwnStall = field(init=False)
    _disk: disk.Disk = field(init=False)
    _lone_thread: beat_witness.LoneThread = field(default_factory=beat_witness.LoneThread)
    _process: process_state.ProcessState = field(default_factory=process_state.ProcessState)
    _processor: processor.Processor = field(default_factory=processor.Processor)
    _collection: collection.Collection = field(default_factory=collection.Collection)
    _progress: progress.Progress = field(default_factory=progress.Progress)
    _transactions: transactions.Transactions = field(default_factory=transactions.Transactions)
    _answers: answers.Answers = field(default_factory=answers.Answers)
    _probe: probe.Probe = field(default_factory=probe.Probe)
    _clocks: clocks.ClockWatch = field(default_factory=clocks.ClockWatch)
    _memory: memory.MemoryKills = field(default_factory=memory.MemoryKills)
    _conduct: conduct.ConductWatch = field(default_factory=conduct.ConductWatch)
    _store: store.Store = field(default_factory=store.Store)
    _stacks: stacks.Stacks = field(default_factory=stacks.Stacks)
    _wishes: Wishes = field(default_factory=Wishes)
    _said: Verdict = GREEN

    def __post_init__(self) -> None:
        self._own_stall = own_stall.OwnStall(self.patience.interval_ms * _NS_PER_MS)
        self._disk = disk.Disk(self.patience.disk_floor_bytes, self.patience.disk_slow_ms)

    @property
    def late_ticks(self) -> int:
        """How many of our own ticks came too late to conclude anything from."""
        return self._own_stall.late_ticks

    def hear(self, fact: StacksSampled | Probed | StoreLooked | StoreTold | Surveyed) -> None:
        """Take in what somebody else found out about this life; the next tick is judged with it."""
        match fact:
            case StacksSampled():
                self._stacks.hear(fact)
            case Probed():
                self._probe.hear(fact)
                self._answers.hear(fact)
            case StoreLooked() | StoreTold():
                self._store.hear(fact)
            case Surveyed():
                self._disk.hear(fact)
                self._conduct.hear(fact)
                self._memory.hear(fact)
            case _:
                assert_never(fact)

    def judge(self, tick: Sampled) -> Verdict:
        """Return the verdict on this tick's facts; what was said last stands if we overslept this one."""
        overslept = self._own_stall.look(tick.at_ns)
        clocks_found = self._clocks.look(tick.clocks, tick.at_ns)
        if clocks_found.slept_ns:
            self._own_stall.forgive(tick.at_ns)
        if tick.beats is None or tick.process is None or not tick.beats.loop_ns:
            return GREEN  # no page or no process to look at: its end is told by the pidfd, not by silence
        look = self._look(tick, tick.beats, tick.process, clocks_found, overslept=overslept)
        if overslept:
            # Nothing is concluded from this look, but that we are late again is known all the same.
            found = starved.judge(look, self.patience)
            return _told(found, self._testimonies(look)) if found else _unasking(self._said)
        said, found = self._testimonies(look), _first(look, self.patience)
        verdict = _told(found, said) if found else _mildest(look, said)
        wishes = self._wishes.of(look, self.patience)
        self._said = replace(verdict, wishes=wishes) if wishes else verdict
        return self._said

    def _look(
        self,
        tick: Sampled,
        beats: Beats,
        sample: ProcessSample,
        clocks_found: clocks.ClockFacts,
        *,
        overslept: bool,
    ) -> Look:
        """Let every witness look."""
        at_ns, forgiven_ns = tick.at_ns, self._own_stall.forgiven_ns
        ages = beat_witness.ages(beats, at_ns, forgiven_ns)
        collecting = self._collection.look(beats, at_ns)
        spent = self._processor.look(beats, sample, at_ns, forgiven_ns, collecting=collecting.touched)
        deciding = self._transactions.look(
            tick.in_flight, sample.deciding, at_ns, self.patience.transaction_ms, overslept=overslept
        )
        silent = ages.loop_stale(self.patience.late_ms)
        return Look(
            at_ns=at_ns,
            threads=tick.threads,
            sample=sample,
            ages=ages,
            alone=self._lone_thread.look(beats),
            process=self._process.look(sample, at_ns, forgiven_ns),
            processor=spent,
            collection=collecting,
            stuck=self._progress.look(beats, tick.in_flight, at_ns, forgiven_ns),
            deciding=deciding,
            unkept=self._answers.look(beats, tick.witness, at_ns, forgiven_ns),
            unanswered=self._probe.look(beats, at_ns, forgiven_ns, excused=silent or collecting.touched),
            clocks=clocks_found,
            disk=self._disk.find(at_ns),
            store=self._store.find(tick.witness, at_ns),
            stacks=self._stacks.find(tick.threads.loop, beats.loop_ns, at_ns),
            in_store_ns=_in_store(tick, beats, forgiven_ns),
            late_often=self._own_stall.often(at_ns),
        )

    def _testimonies(self, look: Look) -> tuple[Testimony, ...]:
        """Return what everybody says: the three who always speak, and whoever else has something to say."""
        late_ms = self.patience.late_ms
        others = (
            processor.testify(look.processor, late_ms),
            collection.testify(look.collection),
            transactions.testify(look.deciding),
            answers.testify(look.unkept, late_ms),
            probe.testify(look.unanswered),
            clocks.testify(look.clocks),
            disk.testify(look.disk),
            store.testify(look.store, look.at_ns),
            stacks.testify(look.stacks),
            resources.testify(look.sample, self.patience.memory_bytes),
            self._memory.testify(look.at_ns),
            *self._conduct.testify(),
        )
        return (
            beat_witness.testify(look.ages, late_ms),
            process_state.testify(look.process, beating=not look.ages.loop_stale(late_ms)),
            progress.testify(look.stuck, late_ms),
            *(told for told in others if told is not None),
        )


def _in_store(tick: Sampled, beats: Beats, forgiven_ns: int) -> int:
    """Return for how long the writer has waited in the store, in ns; deciding there is no waiting."""
    if not beats.in_store_since_ns:
        return 0
    notes = [note for note in tick.in_flight or () if not note.kind.startswith("read")]
    if any(note.stage is SlotStage.DECIDING for note in notes):
        return 0
    return max(0, tick.at_ns - max(beats.in_store_since_ns, forgiven_ns))


def _unasking(said: Verdict) -> Verdict:
    """Return what was said, without asking again."""
    return replace(said, wishes=frozenset()) if said.wishes else said


def _first(look: Look, patience: Patience) -> Verdict | None:
    for _, judge in TABLE:
        found = judge(look, patience)
        if found is not None:
            return found
    return None


def _told(found: Verdict, said: tuple[Testimony, ...]) -> Verdict:
    """Return a diagnosis with what everybody said; where nothing is done, with what worries them."""
    before = said if found.colour is Colour.RED else _worried(said)
    return replace(found, testimonies=(*before, *found.testimonies))


def _worried(said: tuple[Testimony, ...]) -> tuple[Testimony, ...]:
    return tuple(testimony for testimony in said if testimony.colour is not Colour.GREEN)


def _mildest(look: Look, said: tuple[Testimony, ...]) -> Verdict:
    """Return yellow if somebody is worried: one kind of evidence, however red, is not more than that.

    A loop asleep between two beats is what a healthy idle core looks like: alone it is no worry at all.
    """
    worried = _worried(said)
    if look.process.stopped or any(testimony.witness != "process" for testimony in worried):
        return Verdict(Colour.YELLOW, testimonies=worried)
    return GREEN
