"""Since when something has been so: one fact that every look must confirm, or its time begins anew.

Whatever ends a living core must have lasted, in time that we were there to see. The time runs from the look before
the first one that found it so, because two looks are needed to find anything; a look that was not made confirms
nothing either.
"""

import msgspec

from hardcore.sentinel.seen_time import SeenTime

NS_PER_MS = 1_000_000


class Lasting(msgspec.Struct):
    """Remembers since when a thing has held in all looks. `since_ns` 0: it does not hold."""

    since_ns: int = 0
    _looked_ns: int = 0

    def look(self, holds: bool, seen: SeenTime) -> int:  # noqa: FBT001  the one fact
        """Take in whether it holds now; return for how much of the time that we have seen, in ns."""
        if self._looked_ns != seen.before_ns:
            self.since_ns = 0
        self._looked_ns = seen.at_ns
        self.since_ns = (self.since_ns or seen.before_ns) if holds else 0
        return seen.since(self.since_ns) if holds else 0
