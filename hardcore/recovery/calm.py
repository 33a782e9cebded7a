"""Whether this is a good moment to change the core for another: who is there, and is anything being asked?

What the gateway counts is told about once a second. A moment is calm when nobody is connected, or when nothing has been
passed on for some seconds and nothing waits. Where nobody counts nothing is known, so it is not calm. To look at
the core's own counters instead was not chosen: probes and pages of the guard's own move them as well.
"""

import msgspec

from hardcore.model.observations import GatewayCounted
from hardcore.recovery.budget import NS_PER_S

#: Nothing passed on for so long is calm, though somebody is connected.
STILL_NS = 3 * NS_PER_S
#: What was counted holds for so long.
COUNT_HOLDS_NS = 5 * NS_PER_S


class Calm(msgspec.Struct):
    """Remembers the last count, and since when nothing was passed on. Times are monotonic."""

    _counted: GatewayCounted | None = None
    _still_ns: int = 0

    def counted(self, fact: GatewayCounted) -> None:
        """Take in a count."""
        last = self._counted
        if last is None or fact.forwarded != last.forwarded or fact.held:
            self._still_ns = fact.at_ns
        self._counted = fact

    def is_now(self, now_ns: int) -> bool:
        """Return whether a switch would meet nobody, as far as anybody counts."""
        last = self._counted
        if last is None or now_ns - last.at_ns > COUNT_HOLDS_NS or last.held:
            return False
        return last.connections == 0 or now_ns - self._still_ns >= STILL_NS
