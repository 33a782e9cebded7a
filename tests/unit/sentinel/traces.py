"""Small recorded traces: what the watch of a core would have read, tick by tick."""

from collections.abc import Iterable
from typing import Any

import msgspec
from msgspec.structs import replace

from hardcore.model.clocks import Clocks
from hardcore.model.looks import ProcessSample, ThreadSample
from hardcore.model.observations import (
    Probed,
    Sampled,
    StacksSampled,
    StoreLooked,
    StoreTold,
    Surveyed,
)
from hardcore.model.recorder import Beats, CommandNote, LifeState, SlotStage, Threads, Witness
from hardcore.model.verdicts import Colour, Diagnosis, Grade, Verdict
from hardcore.sentinel.seen_time import SeenTime
from hardcore.sentinel.verdict import Bench, Patience

MS = 1_000_000
#: What a bench hears beside its ticks.
Told = StacksSampled | Probed | StoreLooked | StoreTold | Surveyed
#: The watch begins here: zero means "never" on a recorder page.
BEGAN_MS = 1000
#: The thread that decides a command in these traces.
DECIDER = 9
PATIENCE = Patience(interval_ms=100, late_ms=300, conclusive_ms=400, hang_ms=1500)

EPOLL = ThreadSample("S", 5, "ep_poll")
NAPPING = ThreadSample("S", 5, "hrtimer_nanosleep")
LOCKED = ThreadSample("S", 5, "futex_wait_queue")
POLLING = ThreadSample("S", 5, "poll_schedule_timeout")
ON_DISK = ThreadSample("D", 5, "io_schedule")
STOPPED = ThreadSample("T", 5, "do_signal_stop")
GONE = ThreadSample("", 0, "")
UNSCHEDULED = ThreadSample("R", 5, "")


def running(at_ms: int) -> ThreadSample:
    """A thread that gets processor time."""
    return ThreadSample("R", at_ms * MS, "")


def asking(at_ms: int, every_ms: int = 5) -> ThreadSample:
    """A thread that waits for the interpreter: asleep on a lock, awake every 5 ms (where it is let) to ask for it."""
    return ThreadSample("S", at_ms * 10_000, "futex_wait_queue", 0, at_ms // every_ms)


def unlet(at_ms: int) -> ThreadSample:
    """A thread that is ready all the time and is not let."""
    return ThreadSample("R", 5, "", at_ms * MS, at_ms // 100)


def deciding_since(
    at_ms: int, limit_ms: int = 1000, progress_ms: int = 0, kind: str = "transaction"
) -> tuple[CommandNote, ...]:
    """One command that is being decided."""
    return (
        CommandNote(
            SlotStage.DECIDING, "c1", "k1", kind, "t1", (), 1,
            limit_ns=limit_ms * MS,
            stage_ns=(BEGAN_MS + at_ms) * MS,
            progress_ns=progress_ms and (BEGAN_MS + progress_ms) * MS,
            thread=DECIDER,
        ),
    )  # fmt: skip


def seen(at_ms: int, *, since_ms: int = 0, before_ms: int | None = None) -> SeenTime:
    """A look of ours at `at_ms` after one at `before_ms`; nothing before `since_ms` counts."""
    before_ms = at_ms - 100 if before_ms is None else before_ms
    return SeenTime(100 * MS, at_ms * MS, before_ms * MS, since_ms * MS)


class Look(msgspec.Struct, frozen=True):
    """One tick. Beats are given by their age; None for `loop` means that nobody looked closer."""

    at_ms: int
    loop_age_ms: int = 20
    thread_age_ms: int = 20
    state: str = "S"
    loop: ThreadSample | None = EPOLL
    writer: ThreadSample | None = LOCKED
    submitted: int = 0
    completed: int = 0
    in_store_ms: int = 0
    notes: tuple[CommandNote, ...] | None = None
    quiet: bool = False
    beat: ThreadSample | None = None
    busy: int | None = None
    deciding: ThreadSample | None = None
    gc_since_ms: int = 0
    answered_seq: int = 0
    witness_seq: int | None = None
    slept_ms: int = 0
    set_by_ms: int = 0
    burned_ms: int | None = None

    def sampled(self) -> Sampled:
        """As the manager would be told."""
        at_ns = (BEGAN_MS + self.at_ms) * MS
        beats = Beats(
            loop_ns=at_ns - self.loop_age_ms * MS,
            thread_ns=at_ns - self.thread_age_ms * MS,
            submitted=self.submitted,
            completed=self.completed,
            in_store_since_ns=self.in_store_ms and (BEGAN_MS + self.in_store_ms) * MS,
            gc_since_ns=self.gc_since_ms and (BEGAN_MS + self.gc_since_ms) * MS,
            epoch=4,
            state=LifeState.READY,
            answered_seq=self.answered_seq,
        )
        spent_ns = 5 if self.quiet else at_ns // 2
        process = ProcessSample(
            self.state,
            spent_ns if self.burned_ms is None else self.burned_ms * MS,
            1,
            4,
            None,
            self.loop,
            self.writer,
            self.beat,
            ((DECIDER, self.deciding),) if self.deciding else (),
            self.busy,
        )
        witness = None if self.witness_seq is None else Witness(self.witness_seq, 4, "ab", 1)
        boot_ns = at_ns + self.slept_ms * MS
        clocks = Clocks(boot_ns, boot_ns + self.set_by_ms * MS)
        return Sampled(at_ns, 1, beats, Threads(1, 2, 3), process, self.notes, witness, clocks)


def queued(
    *since_ms: int, stage: SlotStage = SlotStage.QUEUED, kind: str = "transaction"
) -> tuple[CommandNote, ...]:
    """Commands in flight, each since its moment."""
    return tuple(
        CommandNote(stage, f"c{n}", f"k{n}", kind, "", (), 1, stage_ns=(BEGAN_MS + at_ms) * MS)
        for n, at_ms in enumerate(since_ms)
    )


def judged(looks: list[Look], patience: Patience = PATIENCE) -> list[Verdict]:
    """What the bench says of each look."""
    bench = Bench(patience)
    return [bench.judge(look.sampled()) for look in looks]


def well(until_ms: int, every_ms: int = 100) -> list[Look]:
    """A healthy core."""
    return [Look(at_ms) for at_ms in range(0, until_ms, every_ms)]


def silent(from_ms: int, for_ms: int, like: Look, *, thread: bool = False, every_ms: int = 100) -> list[Look]:
    """The loop's beats (and the thread's, if `thread`) stop at `from_ms`; each tick looks like `like`."""
    return [
        replace(
            like,
            at_ms=at_ms,
            loop_age_ms=at_ms - from_ms,
            thread_age_ms=at_ms - from_ms if thread else 20,
        )
        for at_ms in range(from_ms + every_ms - 30, from_ms + for_ms, every_ms)
    ]


def red(verdicts: list[Verdict]) -> Verdict | None:
    """The first red one."""
    return next((verdict for verdict in verdicts if verdict.colour is Colour.RED), None)


def heard(looks: Iterable[Look], told: Iterable[Told]) -> list[Verdict]:
    """What the bench says of each look, if it hears each fact at its time."""
    bench, waiting, said = Bench(PATIENCE), sorted(told, key=lambda fact: fact.at_ns), []
    for look in looks:
        tick = look.sampled()
        while waiting and waiting[0].at_ns <= tick.at_ns:
            bench.hear(waiting.pop(0))
        said.append(bench.judge(tick))
    return said


def named(verdicts: list[Verdict]) -> tuple[Diagnosis | None, Grade] | None:
    """The first red one's diagnosis and grade."""
    verdict = red(verdicts)
    return (verdict.diagnosis, verdict.grade) if verdict else None


def at_ns_of(at_ms: int) -> int:
    """A moment of a trace as everybody else tells it."""
    return (BEGAN_MS + at_ms) * MS


def computing(for_ms: int, percent: int = 100) -> list[Look]:
    """The loop computes from 1000 on, with this share of a processor."""
    return [
        Look(at, at - 1000, state="R", loop=running(at * percent // 100))
        for at in range(1070, 1000 + for_ms, 100)
    ]


def deciding(until_ms: int, **more: Any) -> list[Look]:
    """A command is being decided from 100 on."""
    like = Look(0, submitted=1, notes=deciding_since(100), deciding=NAPPING)
    return [replace(like, at_ms=at, **more) for at in range(0, until_ms, 100)]
