"""What can be the matter with a simulated core, as rows of one table.

A condition says what a look from outside would find (beats, kernel states, waits), what still gets done
inside, and whether the guard may call it a hang: `judged` names the patience that applies, `right` the diagnoses
that are true of it. A condition without a patience must never cost a core its life, however long it lasts.
"""

from dataclasses import dataclass
from enum import Enum

import msgspec
from msgspec.structs import replace

from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.policy import Policy

D = Diagnosis


class Judged(Enum):
    """Which patience of the policy makes a hang of it; the value names the setting."""

    NEVER = "never"
    CONCLUSIVE = "confirm_deadlock_ms"
    HANG = "confirm_hang_ms"
    COLLECTION = "gc_grace_ms"
    TRANSACTION = "transaction_timeout_ms"

    def needs_ms(self, policy: Policy) -> int | None:
        """How long it must have lasted before a core may be ended for it; None: never."""
        return None if self is Judged.NEVER else int(getattr(policy, self.value))


class Wait(Enum):
    """What the writer has in its hands that does not end, as the recorder shows it."""

    NOTHING = "nothing"
    DECIDING = "a command that is being decided"
    PROGRESS = "a command that is being decided and says that it goes on"
    STORE = "a batch in the store"


@dataclass(frozen=True, slots=True)
class ThreadLook:
    """A thread as the kernel shows it. `burns`: it gets processor time; `wakes`: again and again, and hardly any;
    `starves`: it is ready and gets none.
    """

    state: str = "S"
    waits_in: str = "futex_wait_queue"
    burns: bool = False
    wakes: bool = False
    starves: bool = False


_IN_EPOLL = ThreadLook("S", "ep_poll", wakes=True)
_STOPPED = ThreadLook("T", "do_signal_stop")
_RUNS = ThreadLook("R", "", burns=True)
_SLEEPS = ThreadLook("S", "hrtimer_nanosleep")
_ON_DISK = ThreadLook("D", "io_schedule")
#: A thread that waits for the interpreter: it asks for it every 5 ms.
_ASKS = ThreadLook(wakes=True)
_STARVES = ThreadLook("R", "", starves=True)


class Condition(msgspec.Struct, frozen=True):
    """One row. `state` is the letter of the whole process; `innermost` the function its stuck thread stands in."""

    name: str
    judged: Judged = Judged.NEVER
    right: frozenset[Diagnosis] = frozenset()
    loop_beats: bool = True
    thread_beats: bool = True
    loop_works: bool = True
    writer_works: bool = True
    state: str = "S"
    loop: ThreadLook = _IN_EPOLL
    writer: ThreadLook = ThreadLook()
    beat: ThreadLook = ThreadLook(wakes=True)
    wait: Wait = Wait.NOTHING
    quiet: bool = False  # no thread of the process gets processor time
    collects: bool = False  # the recorder says that garbage is being collected
    lies: bool = False  # commands are answered and nothing is committed
    cycle: bool = False  # stacks show threads that wait for each other
    innermost: str = "wait"


def _loop(
    name: str, judged: Judged, look: ThreadLook, state: str = "S", *right: Diagnosis, innermost: str = "wait"
) -> Condition:
    """A core whose loop alone stands still."""
    return Condition(
        name, judged, frozenset(right), loop_beats=False, loop_works=False, state=state, loop=look,
        innermost=innermost,
    )  # fmt: skip


def _all(
    name: str, judged: Judged, state: str, loop: ThreadLook, writer: ThreadLook, *right: Diagnosis
) -> Condition:
    """A core in which nothing moves that we could see."""
    return Condition(
        name, judged, frozenset(right), loop_beats=False, thread_beats=False, loop_works=False,
        writer_works=False, state=state, loop=loop, writer=writer, beat=loop,
    )  # fmt: skip


def _writer(name: str, judged: Judged, look: ThreadLook, wait: Wait, *right: Diagnosis) -> Condition:
    """A core whose loop is well and whose writer does not go on."""
    state = look.state or "S"
    return Condition(name, judged, frozenset(right), writer_works=False, state=state, writer=look, wait=wait)


WELL = Condition("well")
FROZEN = _all("frozen", Judged.CONCLUSIVE, "T", _STOPPED, _STOPPED, D.FROZEN)
BLOCKED_TIMER = _loop("blocked in a timer", Judged.CONCLUSIVE, _SLEEPS, "S", D.LOOP_BLOCKED)
BLOCKED_LOCK = _loop("blocked on a lock", Judged.CONCLUSIVE, ThreadLook(), "S", D.LOOP_BLOCKED)
BLOCKED_POLL = _loop(
    "blocked in a wait", Judged.HANG, ThreadLook("S", "poll_schedule_timeout"), "S", D.LOOP_BLOCKED
)
BLOCKED_DISK = _loop("blocked on a disk", Judged.NEVER, _ON_DISK, "D")
#: The main thread ended in an exception and waits for a thread that nobody stops: no beat comes any more.
LOOP_OVER = replace(
    _all("loop over", Judged.CONCLUSIVE, "S", ThreadLook(), ThreadLook(), D.LOOP_BLOCKED, D.GIL_HELD),
    quiet=True,
)
#: Somebody holds the interpreter in a call that sleeps: whoever waits for it wakes up again and again.
GIL_ASLEEP = replace(
    _all("GIL held asleep", Judged.CONCLUSIVE, "S", _ASKS, _SLEEPS, D.GIL_HELD, D.LOOP_BLOCKED), quiet=True
)
SPINNING = _loop("spinning", Judged.HANG, _RUNS, "R", D.SPINNING, innermost="spin")
BUSY = Condition("busy with progress", state="R", loop=_RUNS)
GIL_HELD = _all("GIL held", Judged.HANG, "R", _ASKS, _RUNS, D.GIL_HELD)
#: The same of the loop's own thread: it computes in C and never lets go.
GIL_HELD_BY_LOOP = replace(
    _all("GIL held by the loop", Judged.HANG, "R", _RUNS, _ASKS, D.GIL_HELD, D.SPINNING), beat=_ASKS
)
COLLECTING = replace(GIL_HELD_BY_LOOP, name="collecting", judged=Judged.COLLECTION, collects=True)
#: The moment after: the beat's thread was the first to get the interpreter back, the loop is next.
GIL_RETURNED = _loop("GIL just returned", Judged.NEVER, ThreadLook(), "R")
STARVED = _all("starved", Judged.NEVER, "R", _STARVES, _STARVES)
WRITER_ASLEEP = _writer("writer asleep", Judged.HANG, ThreadLook(), Wait.NOTHING, D.NO_PROGRESS)
WRITER_GONE = _writer("writer gone", Judged.HANG, ThreadLook("", ""), Wait.NOTHING, D.NO_PROGRESS)
SLOW_TRANSACTION = _writer(
    "slow transaction", Judged.TRANSACTION, _SLEEPS, Wait.DECIDING, D.TRANSACTION_TIMEOUT
)
LONG_TRANSACTION = _writer("transaction with progress", Judged.NEVER, _SLEEPS, Wait.PROGRESS)
DEADLOCKED = replace(
    _writer("deadlock", Judged.CONCLUSIVE, ThreadLook(), Wait.DECIDING, D.DEADLOCK, D.TRANSACTION_TIMEOUT),
    cycle=True,
    innermost="wait_for_lock",
)
#: The same where nobody may look at stacks.
DEADLOCKED_UNSEEN = replace(DEADLOCKED, judged=Judged.TRANSACTION, cycle=False)
LYING = Condition("lying", Judged.HANG, frozenset({D.NO_PROGRESS}), lies=True)
#: The loop turns, and nobody is heard or answered.
DEAF = Condition("deaf", Judged.HANG, frozenset({D.NO_PROGRESS}), loop_works=False)
STORE_SLOW = _writer("store slow", Judged.NEVER, _SLEEPS, Wait.STORE)
DISK_SLOW = _writer("disk slow", Judged.NEVER, _ON_DISK, Wait.STORE)
#: What a locked store and a stalled disk make of the writer; the truth stands in the world's store.
WAITS_FOR_STORE = frozenset({STORE_SLOW, DISK_SLOW})
