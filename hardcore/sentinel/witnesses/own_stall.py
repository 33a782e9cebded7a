"""The witness against ourselves: did *we* sleep?

If our own tick came late, the machine was busy or asleep, and everything we would say about the core's
lateness may be our own. What was missed never counts (`seen_time`), and nothing is concluded from the look that came
late: whoever wakes up with us has had no time yet. A guard that forgot this killed healthy processes by the
thousand; one that excuses itself for ever lets a core hang for ever. So a few late looks in a row are excused, and
then it is taken for how this machine is: each counts for little, and enough of them are a judgement all the same.
"""

from collections import deque

import msgspec

#: A tick that comes this many intervals after the last one makes its silence our own.
LATE_INTERVALS = 2.0
#: So many late looks in a row are excused, as the deadline of a phase is.
EXCUSED_MAX = 3
#: So many late ticks within this time, and the machine starves us: then it starves the core as well.
OFTEN_TICKS = 3
OFTEN_WITHIN_NS = 5_000_000_000


class OwnStall(msgspec.Struct):
    """Remembers our last tick, and those that came late."""

    interval_ns: int
    late_ticks: int = 0
    _last_ns: int | None = None
    _in_a_row: int = 0
    _late_at_ns: deque[int] = msgspec.field(default_factory=lambda: deque(maxlen=OFTEN_TICKS))

    def look(self, at_ns: int) -> bool:
        """Note a tick at `at_ns`; return whether it came late."""
        last, self._last_ns = self._last_ns, at_ns
        if last is None or at_ns - last <= self.interval_ns * LATE_INTERVALS:
            self._in_a_row = 0
            return False
        self.late_ticks += 1
        self._in_a_row += 1
        self._late_at_ns.append(at_ns)
        return True

    @property
    def excused(self) -> bool:
        """Whether nothing is to be concluded from the last tick, because it came late."""
        return 0 < self._in_a_row <= EXCUSED_MAX

    def often(self, at_ns: int) -> bool:
        """Return whether our ticks come late again and again."""
        late = self._late_at_ns
        return len(late) == OFTEN_TICKS and at_ns - late[0] <= OFTEN_WITHIN_NS
