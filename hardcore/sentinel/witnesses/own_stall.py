"""The witness against ourselves: did *we* sleep?

If our own tick came late, the machine was busy or asleep, and everything we would say about the core's
lateness may be our own. Then the core gets fresh deadlines: its silence counts only from now on. A guard
that forgot this killed healthy processes by the thousand.
"""

from collections import deque
from dataclasses import dataclass, field

#: A tick that comes this many intervals after the last one makes its silence our own.
LATE_INTERVALS = 2.0
#: So many late ticks within this time, and the machine starves us: then it starves the core as well.
OFTEN_TICKS = 3
OFTEN_WITHIN_NS = 5_000_000_000


@dataclass(slots=True)
class OwnStall:
    """Remembers our last tick. `forgiven_ns`: silence before this moment does not count."""

    interval_ns: int
    forgiven_ns: int = 0
    late_ticks: int = 0
    _last_ns: int | None = None
    _late_at_ns: deque[int] = field(default_factory=lambda: deque(maxlen=OFTEN_TICKS))

    def look(self, at_ns: int) -> bool:
        """Note a tick at `at_ns`; return whether it came so late that nothing can be concluded."""
        last, self._last_ns = self._last_ns, at_ns
        if last is None:
            self.forgiven_ns = at_ns
            return False
        if at_ns - last <= self.interval_ns * LATE_INTERVALS:
            return False
        self.late_ticks += 1
        self._late_at_ns.append(at_ns)
        self.forgiven_ns = at_ns
        return True

    def forgive(self, at_ns: int) -> None:
        """Give everybody fresh deadlines: the machine was away, whatever our ticks say."""
        self.forgiven_ns = at_ns

    def often(self, at_ns: int) -> bool:
        """Return whether our ticks come late again and again."""
        late = self._late_at_ns
        return len(late) == OFTEN_TICKS and at_ns - late[0] <= OFTEN_WITHIN_NS
