"""Weighs what the witnesses say.

Two different kinds of evidence must agree before a living process is called lost: what the core wrote about
itself (beats, queue, stages) and what others say of it (the kernel, the stacks, our own disk). One kind alone
is yellow. Both must have lasted, in time that we were there to see: a core that was busy for long and then slept
for a moment is not blocked. So a busy core, a long garbage collection, a core that the machine does not schedule and
a guard that was itself asleep all stay alive.

The diagnoses are asked in the order of `TABLE`, and the first that speaks is right: what explains a silence from
outside the core comes before what blames it, what is named by two looks at the stacks before what is inferred,
and what ends nobody (a full disk) behind what a full disk does not explain. A look that finds no page, or no process,
has a judge of its own, and is never green.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import assert_never

from msgspec import structs

from hardcore.model.looks import ProcessSample
from hardcore.model.observations import Probed, Sampled, StacksSampled, StoreLooked, StoreTold, Surveyed
from hardcore.model.recorder import Beats, SlotStage
from hardcore.model.verdicts import GREEN, Colour, Diagnosis, Testimony, Verdict
from hardcore.sentinel.diagnoses import (
    component_stalled,
    db_locked,
    deadlock,
    disk_full,
    disk_read_only,
    disk_stalled,
    frozen,
    gil_held,
    loop_blocked,
    no_progress,
    pageless,
    slept,
    spinning,
    starved,
    transaction_timeout,
)
from hardcore.sentinel.lasting import NS_PER_MS
from hardcore.sentinel.look import Look
from hardcore.sentinel.patience import Patience
from hardcore.sentinel.seen_time import SeenTime
from hardcore.sentinel.wishes import Wishes
from hardcore.sentinel.witnesses import (
    answers,
    clocks,
    collection,
    components,
    conduct,
    disk,
    memory,
    own_stall,
    probe,
    process_state,
    processor,
    progress,
    resources,
    sight,
    stacks,
    store,
    transactions,
)
from hardcore.sentinel.witnesses import beats as beat_witness

__all__ = ["Bench", "Patience"]

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
    (Diagnosis.COMPONENT_STALLED, component_stalled.judge),
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
    _seen: SeenTime = field(init=False)
    _disk: disk.Disk = field(init=False)
    _sight: sight.Sight = field(default_factory=sight.Sight)
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
    _components: components.Components = field(default_factory=components.Components)
    _wishes: Wishes = field(default_factory=Wishes)
    _said: Verdict = GREEN
    _blind: bool = False

    def __post_init__(self) -> None:
        patience = self.patience
        self._own_stall = own_stall.OwnStall(patience.interval_ms * NS_PER_MS)
        self._seen = SeenTime(patience.interval_ms * NS_PER_MS)
        self._disk = disk.Disk(patience.disk_floor_bytes, patience.disk_slow_ms, patience.survey_ms)

    def adopt(self, patience: Patience) -> None:
        """Go by other numbers from now on; what was seen stays seen."""
        self.patience = patience
        self._own_stall.interval_ns = self._seen.interval_ns = patience.interval_ms * NS_PER_MS
        self._disk.adopt(patience.disk_floor_bytes, patience.disk_slow_ms, patience.survey_ms)

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
        self._seen.look(tick.at_ns, late=self._own_stall.look(tick.at_ns))
        found = self._clocks.look(tick.clocks, tick.at_ns)
        if found.slept_ns:
            self._seen.forgive()
        missing, blind = self._sight.look(tick), self._blind
        self._blind = bool(missing.page or missing.process)
        if self._blind:
            self._said = self._judge_what_remains(tick, missing, found)
            return self._said
        assert tick.beats is not None, "nothing is missing"
        assert tick.process is not None, "as above"
        if not tick.beats.loop_ns:
            return GREEN  # it has not begun to beat
        look = self._look(tick, tick.beats, tick.process, found, blind=blind)
        return self._conclude_nothing(look) if self._own_stall.excused else self._conclude(look)

    def _conclude(self, look: Look) -> Verdict:
        said, found = self._testimonies(look), _first(look, self.patience)
        verdict = _told(found, said) if found else _mildest(look, said)
        wishes = self._wishes.of(look, self.patience)
        self._said = structs.replace(verdict, wishes=wishes) if wishes else verdict
        return self._said

    def _conclude_nothing(self, look: Look) -> Verdict:
        """Say of a look that came late what is known all the same: that the machine slept, that we are late again."""
        found = slept.judge(look, self.patience) or starved.judge(look, self.patience)
        if found is not None:
            return _told(found, self._testimonies(look))
        return structs.replace(self._said, wishes=frozenset()) if self._said.wishes else self._said

    def _judge_what_remains(
        self, tick: Sampled, missing: sight.Missing, clocks_found: clocks.ClockFacts
    ) -> Verdict:
        """Judge a core that can't be seen whole. Without its process nobody is ended.

        The process is readable for whoever may end it: if it is not, we may be the ones who are ill (out of
        descriptors), and then no probe of ours is answered either.
        """
        said, found = sight.testify(missing), None
        if not missing.page and tick.beats is not None:
            ages = beat_witness.ages(tick.beats, self._seen)
            said = (*said, beat_witness.testify(ages, self.patience.late_ms))
        if missing.page and tick.process is not None:
            facts = self._process.look(tick.process, self._seen)
            unanswered = self._probe.look(None, self._seen)
            remains = pageless.Remains(facts, unanswered, self._disk.find(self._seen))
            found = None if self._own_stall.excused else pageless.judge(remains, self.patience)
            silent = process_state.testify(facts, beating=unanswered is None)
            said = (*said, silent, *(told for told in (probe.testify(unanswered),) if told))
        said = (*said, *(told for told in (clocks.testify(clocks_found),) if told))
        return _told(found, said) if found else Verdict(Colour.YELLOW, testimonies=_worried(said))

    def _look(
        self,
        tick: Sampled,
        beats: Beats,
        sample: ProcessSample,
        clocks_found: clocks.ClockFacts,
        *,
        blind: bool,
    ) -> Look:
        """Let every witness look. `blind`: at the look before there was no page or no process to see.

        What was silent then may have had any reason: it is no silence of a loop that turned.
        """
        seen = self._seen
        ages = beat_witness.ages(beats, seen)
        collecting = self._collection.look(beats, seen.at_ns)
        spent = self._processor.look(beats, sample, seen, collecting=collecting.touched)
        # What else explains that nobody is answered; a stop has its own patience.
        explained = (
            ages.loop_stale(self.patience.late_ms) or collecting.touched or blind or sample.state == "T"
        )
        return Look(
            at_ns=seen.at_ns,
            threads=tick.threads,
            sample=sample,
            ages=ages,
            alone=self._lone_thread.look(beats),
            process=self._process.look(sample, seen),
            processor=spent,
            collection=collecting,
            stuck=self._progress.look(beats, tick.in_flight, seen),
            deciding=self._transactions.look(
                tick.in_flight, sample.deciding, self.patience.transaction_ms, seen
            ),
            unkept=self._answers.look(beats, tick.witness, seen),
            unanswered=self._probe.look(beats, seen, excused=explained),
            clocks=clocks_found,
            disk=self._disk.find(seen),
            store=self._store.find(tick.witness, seen),
            stacks=self._stacks.find(tick.threads.loop, beats.loop_ns, seen.at_ns),
            in_store_ns=_in_store(tick, beats, seen),
            late_often=self._own_stall.often(seen.at_ns),
            stalled=self._components.look(tick.components, seen),
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
            store.testify(look.store),
            stacks.testify(look.stacks),
            components.testify(look.stalled),
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


def _in_store(tick: Sampled, beats: Beats, seen: SeenTime) -> int:
    """Return for how long the writer has waited in the store, in ns; deciding there is no waiting."""
    if not beats.in_store_since_ns:
        return 0
    notes = [note for note in tick.in_flight or () if not note.kind.startswith("read")]
    if any(note.stage is SlotStage.DECIDING for note in notes):
        return 0
    return seen.since(beats.in_store_since_ns)


def _first(look: Look, patience: Patience) -> Verdict | None:
    for _, judge in TABLE:
        found = judge(look, patience)
        if found is not None:
            return found
    return None


def _told(found: Verdict, said: tuple[Testimony, ...]) -> Verdict:
    """Return a diagnosis with what everybody said; where nothing is done, with what worries them."""
    before = said if found.colour is Colour.RED else _worried(said)
    return structs.replace(found, testimonies=(*before, *found.testimonies))


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
