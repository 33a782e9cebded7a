"""Since when something has been so: one fact that every look must confirm, or its time begins anew.

Whatever ends a living core must have lasted. The time runs from the look before the first one that found it
so, because two looks are needed to find anything, and never from before an amnesty.
"""

from dataclasses import dataclass

NS_PER_MS = 1_000_000


@dataclass(slots=True)
class Lasting:
    """Remembers since when a thing has held in all looks. `since_ns` 0: it does not hold."""

    since_ns: int = 0

    def look(self, holds: bool, before_ns: int, at_ns: int, forgiven_ns: int) -> int:  # noqa: FBT001  the one fact
        """Take in whether it holds now; return for how long it has, in ns, not counting time before `forgiven_ns`."""
        self.since_ns = (self.since_ns or before_ns) if holds else 0
        return max(0, at_ns - max(self.since_ns, forgiven_ns)) if self.since_ns else 0
