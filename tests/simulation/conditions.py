"""What can be the matter with a simulated core, as rows of one table.

A condition says what a look from outside would find (beats, kernel states, waits), what still gets done
inside, and whether the guard may call it a hang: `judged` names the patience that applies. A condition
without one must never cost a core its life, however long it lasts.
"""

from dataclasses import dataclass, replace
from enum import Enum


class Judged(Enum):
    """Which patience of the policy makes a hang of it."""

    NEVER = "never"
    CONCLUSIVE = "confirm_deadlock_ms"
    HANG = "confirm_hang_ms"


@dataclass(frozen=True, slots=True)
class ThreadLook:
    """A thread as the kernel shows it. `burns`: it gets processor time."""

    state: str = "S"
    waits_in: str = "futex_wait_queue"
    burns: bool = False


_IN_EPOLL = ThreadLook("S", "ep_poll")
_STOPPED = ThreadLook("T", "do_signal_stop")
_RUNS = ThreadLook("R", "", burns=True)


@dataclass(frozen=True, slots=True)
class Condition:
    """One row. `state` is the letter of the whole process."""

    name: str
    judged: Judged = Judged.NEVER
    loop_beats: bool = True
    thread_beats: bool = True
    loop_works: bool = True
    writer_works: bool = True
    state: str = "S"
    loop: ThreadLook = _IN_EPOLL
    writer: ThreadLook = ThreadLook()
    in_store: bool = False
    quiet: bool = False  # no thread of the process gets processor time


def _loop(name: str, judged: Judged, look: ThreadLook, state: str = "S") -> Condition:
    """A core whose loop alone stands still."""
    return Condition(name, judged, loop_beats=False, loop_works=False, state=state, loop=look)


def _all(name: str, judged: Judged, state: str, loop: ThreadLook, writer: ThreadLook) -> Condition:
    """A core in which nothing moves that we could see."""
    return Condition(
        name, judged, loop_beats=False, thread_beats=False, loop_works=False, writer_works=False,
        state=state, loop=loop, writer=writer,
    )  # fmt: skip


WELL = Condition("well")
FROZEN = _all("frozen", Judged.CONCLUSIVE, "T", _STOPPED, _STOPPED)
BLOCKED_TIMER = _loop("blocked in a timer", Judged.CONCLUSIVE, ThreadLook("S", "hrtimer_nanosleep"))
BLOCKED_LOCK = _loop("blocked on a lock", Judged.CONCLUSIVE, ThreadLook())
BLOCKED_POLL = _loop("blocked in a wait", Judged.HANG, ThreadLook("S", "poll_schedule_timeout"))
BLOCKED_DISK = _loop("blocked on a disk", Judged.NEVER, ThreadLook("D", "io_schedule"), "D")
#: The main thread ended in an exception and waits for a thread that nobody stops: no beat comes any more.
LOOP_OVER = replace(_all("loop over", Judged.HANG, "S", ThreadLook(), ThreadLook()), quiet=True)
#: Somebody holds the interpreter in a call that sleeps: whoever waits for it wakes up again and again.
GIL_ASLEEP = replace(
    _all("GIL held asleep", Judged.NEVER, "S", ThreadLook(burns=True), ThreadLook()), quiet=True
)
SPINNING = _loop("spinning", Judged.NEVER, _RUNS, "R")
BUSY = Condition("busy with progress", state="R", loop=_RUNS)
GIL_HELD = _all("GIL held", Judged.NEVER, "R", ThreadLook(), _RUNS)
#: The moment after: the beat's thread was the first to get the interpreter back, the loop is next.
GIL_RETURNED = _loop("GIL just returned", Judged.NEVER, ThreadLook(), "R")
STARVED = _all("starved", Judged.NEVER, "R", ThreadLook("R", ""), ThreadLook("R", ""))
WRITER_ASLEEP = Condition("writer asleep", Judged.HANG, writer_works=False)
WRITER_GONE = Condition("writer gone", Judged.HANG, writer_works=False, writer=ThreadLook("", ""))
STORE_SLOW = Condition(
    "store slow", writer_works=False, writer=ThreadLook("S", "hrtimer_nanosleep"), in_store=True
)
DISK_SLOW = Condition("disk slow", writer_works=False, writer=ThreadLook("D", "io_schedule"), in_store=True)
