"""Weighs what the witnesses say.

Two different kinds of evidence must agree before a living process is called lost: what the core wrote about
itself (beats, queue) and what the kernel says of it (stopped, asleep without processor time). One kind alone
is yellow. Both must have lasted: a core that was busy for long and then slept for a moment is not blocked.
So a busy core, a long garbage collection, a core that the machine does not schedule and a guard that was
itself asleep all stay alive.
"""

from collections import deque
from dataclasses import dataclass, field

from hardcore.model.observations import Probed, Sampled, StacksSampled, StoreLooked, StoreTold, Surveyed
from hardcore.model.verdicts import GREEN, Colour, Diagnosis, Grade, Testimony, Verdict
from hardcore.sentinel.patience import Patience
from hardcore.sentinel.witnesses import beats as beat_witness
from hardcore.sentinel.witnesses import process_state, progress
from hardcore.sentinel.witnesses.own_stall import OwnStall
from hardcore.sentinel.witnesses.process_state import ProcessFacts, Sleep

_NS_PER_MS = 1_000_000

__all__ = ["Bench", "Patience"]


@dataclass(slots=True)
class Bench:
    """The witnesses of one life, and their judge.

    Made anew for each core: nothing that was held against one may be held against its successor.
    """

    patience: Patience
    _own_stall: OwnStall = field(init=False)
    _lone_thread: beat_witness.LoneThread = field(default_factory=beat_witness.LoneThread)
    _process: process_state.ProcessState = field(default_factory=process_state.ProcessState)
    _progress: progress.Progress = field(default_factory=progress.Progress)
    _heard: deque[StacksSampled | Probed | StoreLooked | StoreTold | Surveyed] = field(
        default_factory=lambda: deque(maxlen=4)
    )
    _said: Verdict = GREEN

    def __post_init__(self) -> None:
        self._own_stall = OwnStall(self.patience.interval_ms * _NS_PER_MS)

    @property
    def late_ticks(self) -> int:
        """How many of our own ticks came too late to conclude anything from."""
        return self._own_stall.late_ticks

    def hear(self, fact: StacksSampled | Probed | StoreLooked | StoreTold | Surveyed) -> None:
        """Take in what somebody else found out; the next tick is judged with it."""
        self._heard.append(fact)

    def judge(self, tick: Sampled) -> Verdict:
        """Return the verdict on this tick's facts; what was said last stands if we overslept this one."""
        overslept = self._own_stall.look(tick.at_ns)
        if tick.beats is None or tick.process is None or not tick.beats.loop_ns:
            return GREEN  # no page or no process to look at: its end is told by the pidfd, not by silence
        alone = self._lone_thread.look(tick.beats)
        facts = self._process.look(tick.process, tick.at_ns, self._own_stall.forgiven_ns)
        found = beat_witness.ages(tick.beats, tick.at_ns, self._own_stall.forgiven_ns)
        stuck = self._progress.look(tick.beats, tick.in_flight, tick.at_ns, self._own_stall.forgiven_ns)
        said = (
            beat_witness.testify(found, self.patience.late_ms),
            process_state.testify(facts, beating=not found.loop_stale(self.patience.late_ms)),
            progress.testify(stuck, self.patience.late_ms),
        )
        if overslept:
            return self._said
        self._said = (
            self._frozen(found, facts, said)
            or (self._blocked(found, facts, said) if alone else self._ended(found, facts, said))
            or self._no_progress(found, facts, stuck, said)
            or _mildest(said, facts)
        )
        return self._said

    def _frozen(
        self, found: beat_witness.BeatAges, facts: ProcessFacts, said: tuple[Testimony, ...]
    ) -> Verdict | None:
        limit_ms = self.patience.conclusive_ms
        if facts.stopped and facts.stopped_ns >= limit_ms * _NS_PER_MS and found.loop_stale(limit_ms):
            return Verdict(Colour.RED, Diagnosis.FROZEN, Grade.CERTAIN, found.last_loop_ns, said)
        return None

    def _blocked(
        self, found: beat_witness.BeatAges, facts: ProcessFacts, said: tuple[Testimony, ...]
    ) -> Verdict | None:
        if facts.loop not in {Sleep.CONCLUSIVE, Sleep.OTHER}:
            return None
        sure = facts.loop is Sleep.CONCLUSIVE
        limit_ms = self.patience.conclusive_ms if sure else self.patience.hang_ms
        if facts.loop_ns < limit_ms * _NS_PER_MS or not found.loop_stale(limit_ms):
            return None
        grade = Grade.CERTAIN if sure else Grade.LIKELY
        return Verdict(Colour.RED, Diagnosis.LOOP_BLOCKED, grade, found.last_loop_ns, said)

    def _ended(
        self, found: beat_witness.BeatAges, facts: ProcessFacts, said: tuple[Testimony, ...]
    ) -> Verdict | None:
        """Judge a core whose loop and whose beats' thread are both over while some thread keeps it alive.

        A held interpreter looks like it, but somebody computes then, or whoever waits for it wakes up again
        and again: so the loop must have slept on a lock, and the whole process without processor time.
        """
        limit_ms = self.patience.hang_ms
        lasted_ns = min(found.loop_ns, found.thread_ns, facts.loop_ns, facts.quiet_ns)
        if facts.loop is not Sleep.CONCLUSIVE or lasted_ns < limit_ms * _NS_PER_MS:
            return None
        why = "no thread of the process had any processor time meanwhile"
        fact = Testimony("process", Colour.RED, why)
        return Verdict(Colour.RED, Diagnosis.LOOP_BLOCKED, Grade.LIKELY, found.last_loop_ns, (*said, fact))

    def _no_progress(
        self,
        found: beat_witness.BeatAges,
        facts: ProcessFacts,
        stuck: progress.Stuck | None,
        said: tuple[Testimony, ...],
    ) -> Verdict | None:
        limit_ns = self.patience.hang_ms * _NS_PER_MS
        if stuck is None or stuck.for_ns < limit_ns or found.loop_stale(self.patience.late_ms):
            return None
        if facts.writer is Sleep.NOT or facts.writer_ns < limit_ns:
            return None
        gone = facts.writer is Sleep.GONE
        why = "the writer's thread is gone" if gone else "the writer's thread sleeps without processor time"
        fact = Testimony("process", Colour.RED, why)
        grade = Grade.CERTAIN if gone else Grade.LIKELY
        return Verdict(Colour.RED, Diagnosis.NO_PROGRESS, grade, stuck.since_ns, (*said, fact))


def _mildest(said: tuple[Testimony, ...], facts: ProcessFacts) -> Verdict:
    """Return yellow if somebody is worried: one kind of evidence, however red, is not more than that.

    A loop asleep between two beats is what a healthy idle core looks like: alone it is no worry at all.
    """
    worried = tuple(t for t in said if t.colour is not Colour.GREEN)
    if facts.stopped or any(t.witness != "process" for t in worried):
        return Verdict(Colour.YELLOW, testimonies=worried)
    return GREEN
