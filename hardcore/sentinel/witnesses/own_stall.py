"""The witness against ourselves: did *we* sleep?

If our own tick came late, the machine was busy or asleep, and everything we would say about the core's
lateness may be our own. Then the core gets fresh deadlines: its silence counts only from now on. A guard
that forgot this killed healthy processes by the thousand.
"""

from dataclasses import dataclass

#: A tick that comes this many intervals after the last one makes its silence our own.
LATE_INTERVALS = 2.0


@dataclass(slots=True)
class OwnStall:
    """Remembers our last tick. `forgiven_ns`: silence before this moment does not count."""

    interval_ns: int
    forgiven_ns: int = 0
    late_ticks: int = 0
    _last_ns: int | None = None

    def look(self, at_ns: int) -> bool:
        """Note a tick at `at_ns`; return whether it came so late that nothing can be concluded."""
        last, self._last_ns = self._last_ns, at_ns
        if last is None:
            self.forgiven_ns = at_ns
            return False
        if at_ns - last <= self.interval_ns * LATE_INTERVALS:
            return False
        self.late_ticks += 1
        self.forgiven_ns = at_ns
        return True
