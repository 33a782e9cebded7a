"""What somebody outside sees of a simulated core: its page, what the kernel says of it, its stacks.

Beats are not events: they are computed when somebody looks, from when they stopped, so that a core that is well
costs nothing. A look may also be spoilt: torn, so that nothing can be read, late, so that it shows what was
there a while ago, or of a page that somebody writes all over.
"""

from dataclasses import dataclass
from enum import Enum
from random import Random
from typing import Any

from msgspec.structs import fields, replace

from hardcore.model.looks import ProcessSample, StackFrame, ThreadSample, ThreadStack
from hardcore.model.recorder import Beats, CommandNote, ComponentBeat, LifeState, Page, SlotStage, Threads
from hardcore.model.verdicts import Diagnosis
from tests.simulation.clock import NS_PER_MS
from tests.simulation.conditions import DISK_SLOW, STORE_SLOW, WELL, Condition, Judged, ThreadLook, Wait
from tests.simulation.machine import Life
from tests.simulation.store import Disk

BEAT_NS = 50 * NS_PER_MS
#: How long a part of the core may be silent.
PART_LIMIT_NS = 1_000 * NS_PER_MS
THREADS = Threads(loop=1, writer=2, beat=3)
#: The other thread of a deadlock.
WORKER = 4


def row_of(life: Life) -> Condition:
    """Return what is the matter with it, as far as anybody outside could see."""
    if life.condition is WELL and life.in_store_ns:
        return DISK_SLOW if life.world.store.disk is Disk.STALLED else STORE_SLOW
    return life.condition


def seen_of(life: Life) -> Condition:
    """Return what may be said of it: without its page only what the kernel shows of a core that answers nobody."""
    row = life.condition
    unseen = life.page_lost or life.world.clock.now_ns < life.world.unseen_until_ns
    if not unseen or row.loop_works or row.judged is Judged.NEVER:
        return row
    asleep = frozenset({Diagnosis.LOOP_BLOCKED} if row.state == "S" else ())
    return replace(row, right=row.right | asleep)


def beats(life: Life) -> Beats:
    """The beat block now."""
    loop_ns, thread_ns = _beat(life, life.loop_silent_ns), _beat(life, life.thread_silent_ns)
    row = row_of(life)
    stuck = _stuck(life, row)
    in_store_ns = life.in_store_ns or (life.since_ns if row.wait is Wait.STORE and life.slots else 0)
    return Beats(
        loop_ns, loop_ns // BEAT_NS, thread_ns, thread_ns // BEAT_NS,
        life.submitted + life.extra_waiting + len(stuck), life.completed, life.completed_ns,
        in_store_ns, life.began_ns if row.collects else 0, life.epoch or 0, _state(life),
        life.claimed_seq,
    )  # fmt: skip


def _state(life: Life) -> LifeState:
    if life.waits:
        return LifeState.SPARE
    if not life.completed_boot:
        return LifeState.STARTING
    return LifeState.DRAINING if life.draining else LifeState.READY


def _beat(life: Life, silent_ns: int | None) -> int:
    now_ns = life.world.clock.now_ns
    last_ns = now_ns if silent_ns is None else min(now_ns, silent_ns)
    return last_ns - (last_ns - life.serial * 7_000_003) % BEAT_NS


def _stuck(life: Life, row: Condition) -> tuple[CommandNote, ...]:
    """The command that the writer has in its hands and does not finish."""
    if row.wait not in {Wait.DECIDING, Wait.PROGRESS}:
        return ()
    progress_ns = life.world.clock.now_ns - 30 * NS_PER_MS if row.wait is Wait.PROGRESS else 0
    return (
        CommandNote(
            SlotStage.DECIDING, f"stuck-{life.serial}", "", "drill", "tx-1", ("acc-1",), life.began_ns,
            life.world.policy.transaction_timeout_ms * NS_PER_MS, life.began_ns, progress_ns, THREADS.writer,
        ),
    )  # fmt: skip


def notes(life: Life) -> tuple[CommandNote, ...]:
    """The commands in flight."""
    limit_ns = life.world.policy.transaction_timeout_ms * NS_PER_MS
    own = (slot.note(limit_ns) for slot in life.slots.values())
    return (*own, *_stuck(life, row_of(life)), *life.extra_notes)


def process(life: Life, *, closer: bool) -> ProcessSample:
    """The process as the kernel shows it; threads only when somebody looks closer."""
    row, now_ns = row_of(life), life.world.clock.now_ns
    spent_ns = life.since_ns // 2 if row.quiet else now_ns // 2
    if not closer:
        return ProcessSample(row.state, spent_ns, life.rss_bytes, 4)
    writer = _thread(row.writer, now_ns)
    deciding = ((THREADS.writer, writer),) if row.wait in {Wait.DECIDING, Wait.PROGRESS} else ()
    return ProcessSample(
        row.state, spent_ns, life.rss_bytes, 4, None,
        _thread(row.loop, now_ns), writer, _thread(row.beat, now_ns), deciding,
        int(row.writer.state in {"R", "D"}),
    )  # fmt: skip


def _thread(look: ThreadLook, now_ns: int) -> ThreadSample:
    spent_ns = now_ns if look.burns else now_ns // 2_000 if look.wakes else 5
    return ThreadSample(
        look.state, spent_ns, look.waits_in,
        now_ns if look.starves else now_ns // 5_000 if look.wakes or look.burns else 0,
        now_ns // (5 * NS_PER_MS) if look.wakes or look.burns else 7,
    )  # fmt: skip


def stacks(life: Life) -> tuple[ThreadStack, ...]:
    """All threads' frames."""
    row = row_of(life)
    busy = not row.loop_works or row.loop.burns
    # Whoever is busy and gets on is met somewhere else each time.
    line = 10 if not row.loop_works else life.world.rng.randrange(10, 500)
    loop = _frames("run", row.innermost if busy else "select", line)
    writer = _frames("write", row.innermost if not row.writer_works else "get", 20)
    threads = [
        ThreadStack(THREADS.loop, "loop", row.loop.burns, row.loop.burns, loop),
        ThreadStack(THREADS.writer, "writer", row.writer.burns, row.writer.burns, writer),
        ThreadStack(THREADS.beat, "beat", False, False, _frames("beat", "wait", 5)),
    ]
    if row.cycle:
        threads[1] = ThreadStack(THREADS.writer, "writer", False, False, _waiting("accounts", WORKER))
        threads.append(ThreadStack(WORKER, "worker", False, False, _waiting("rates", THREADS.writer)))
    return tuple(threads)


def _frames(*functions: str | int) -> tuple[StackFrame, ...]:
    outer, inner, line = functions
    return (StackFrame(str(inner), "core.py", int(line)), StackFrame(str(outer), "core.py", 1))


def _waiting(lock: str, holder: int) -> tuple[StackFrame, ...]:
    names = (("lock_name", lock), ("held_by", str(holder)))
    return (StackFrame("wait_for_lock", "locks.py", 30, names), StackFrame("decide", "core.py", 1))


def page(life: Life) -> Page | None:
    """The whole recorder page."""
    if life.page_lost:
        return None
    return Page(
        f"{life.serial:016x}", "boot", 1000 + life.serial, 1, THREADS, beats(life), life.witness,
        life.words, notes(life), (), (),
    )  # fmt: skip


class Spoiling(Enum):
    """How a look at the page goes wrong."""

    TORN = "nothing can be read"
    LATE = "it shows what stood there a while ago"
    NONSENSE = "somebody writes all over it"


@dataclass(slots=True)
class Spoilt:
    """How the next looks at the page go wrong. `until_ns`: from then on all is well."""

    until_ns: int = 0
    how: Spoiling = Spoiling.TORN
    old: Beats | None = None

    def look(self, life: Life) -> Beats | None:
        """Return the beats that are read now."""
        if life.page_lost:
            return None
        if life.world.clock.now_ns >= self.until_ns:
            return beats(life)
        match self.how:
            case Spoiling.TORN:
                return None
            case Spoiling.LATE:
                self.old = self.old or beats(life)
                return self.old
            case Spoiling.NONSENSE:
                return _nonsense(beats(life), life.world.rng)


def _nonsense(true: Beats, rng: Random) -> Beats:
    """Beats of which somebody has written over every field but the state, which would be noticed."""
    written: dict[str, Any] = {
        field.name: rng.randrange(1 << rng.choice([1, 20, 40, 63]))
        for field in fields(Beats)
        if field.name != "state"
    }
    return replace(true, **written)


def parts(life: Life) -> tuple[ComponentBeat, ...]:
    """The table of a core's parts, as its page shows it."""
    beat_ns = life.part_stalled_ns or life.world.clock.now_ns
    return (ComponentBeat("importer", beat_ns, beat_ns, PART_LIMIT_NS, 1),)
