"""The witness of the out-of-memory counter: has the kernel killed for memory where this core lives?

It may have been a child's, or a neighbour's in the same group: of a living core it is worth saying for a while and
nothing more. Of a dead one it tells who killed it, which `deaths` reads from the fact of the death itself.
"""

import msgspec

from hardcore.model.observations import Surveyed
from hardcore.model.verdicts import Colour, Testimony

#: So long after it was counted it is still worth saying.
TOLD_NS = 60_000_000_000


class MemoryKills(msgspec.Struct):
    """Remembers the counter and when it last rose."""

    _kills: int = 0
    _rose_ns: int = 0

    def hear(self, fact: Surveyed) -> None:
        """Take in the counter, which begins at 0 with the life."""
        if fact.oom_kills is not None and fact.oom_kills > self._kills:
            self._rose_ns = fact.at_ns
        self._kills = fact.oom_kills if fact.oom_kills is not None else self._kills

    def testify(self, at_ns: int) -> Testimony | None:
        """Return that the kernel has killed for memory lately, or None."""
        if not self._kills or at_ns - self._rose_ns > TOLD_NS:
            return None
        why = f"the kernel has killed for memory where the core lives, times counted: {self._kills}"
        return Testimony("memory", Colour.YELLOW, why)
