"""When a sentinel is to be replaced: the agent's decision, from what was seen of it, without a clock and without an act.

A death is certain and needs no second opinion. A sentinel that stands still is believed to only when its own beats and the
kernel say so, both for a while that we were awake for: after a look that came late everything begins anew, because
whatever kept us may have kept it. Who waits for a disk or for a processor is not frozen. Not chosen: one limit for the age
of a beat; under it, whoever is starved of processor time would be killed for it.
"""

from enum import Enum

import msgspec

#: How often it is looked. A look that comes after twice as long was late.
LOOK_NS = 250_000_000
LATE_LOOKS = 2
#: A loop that stands still beside a thread that beats is given this many times the patience.
ALONE_TIMES = 3


class Finding(Enum):
    """What is to be thought of the sentinel."""

    WELL = "it beats, or nobody can tell"
    DEAD = "its process is gone"
    FROZEN = "it stands still, and the kernel agrees"


class Body(msgspec.Struct, frozen=True):
    """What the kernel says of its threads: how often they were given a processor, and what they wait for."""

    stopped: bool  # by a signal or a tracer, all of it
    asleep: bool  # each thread sleeps, none runs, is ready to, or waits for a disk
    turns: int  # times that any of them began or ceased to run
    loop_asleep: bool
    loop_turns: int


class Seen(msgspec.Struct, frozen=True):
    """One look. `beats`: of the loop and of the thread beside it; None: its page can't be read."""

    at_ns: int
    gone: bool
    beats: tuple[int, int] | None = None
    body: Body | None = None


class Table(msgspec.Struct):
    """Remembers since when each thing has stood still."""

    _last_ns: int | None = None
    _since: dict[str, tuple[object, int]] = {}

    def judge(self, seen: Seen, stale_ns: int, after_ns: int) -> Finding:
        """Return what is to be thought after this look."""
        last, self._last_ns = self._last_ns, seen.at_ns
        if seen.gone:
            return Finding.DEAD
        if last is None or seen.at_ns - last > LATE_LOOKS * LOOK_NS:
            self._since.clear()
        loop_ns, thread_ns = (None, None) if seen.beats is None else seen.beats
        loop_is_still = self._lasts("loop", loop_ns, seen.at_ns) >= stale_ns
        thread_is_still = self._lasts("thread", thread_ns, seen.at_ns) >= stale_ns
        body = seen.body if loop_is_still else None
        nobody_runs = self._lasts("all", _nobody_runs(body) if thread_is_still else None, seen.at_ns)
        alone = body.loop_turns if body is not None and body.loop_asleep else None
        loop_sleeps = self._lasts("alone", alone, seen.at_ns)
        if nobody_runs >= max(1, after_ns) or loop_sleeps >= ALONE_TIMES * stale_ns:
            return Finding.FROZEN
        return Finding.WELL

    def _lasts(self, what: str, value: object | None, now_ns: int) -> int:
        """Return for how long this has had the value; -1: it has none."""
        if value is None:
            self._since.pop(what, None)
            return -1
        if self._since.get(what, (None, 0))[0] != value:
            self._since[what] = (value, now_ns)
        return now_ns - self._since[what][1]


def _nobody_runs(body: Body | None) -> object | None:
    """Return what stays the same as long as none of its threads runs; None: one does, or nobody can tell."""
    if body is None:
        return None
    if body.stopped:
        return "stopped"
    return body.turns if body.asleep else None
