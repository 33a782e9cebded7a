"""How much the core grew while a command was executed: the only thing that makes one suspect of a death for memory.

The kernel ends whoever is largest when memory runs out, and the command that was being decided then is most often an
innocent that asked for the last page. So it is suspect only if the core itself grew during it, by more than a
healthy command can need.
"""

from collections import deque

import msgspec

from hardcore.model.recorder import CommandNote

#: A minute of ticks at the shipped interval.
LOOKS_MAX = 600
#: A command during which the core grew by this is suspect: the largest body it takes is half of it.
GREW_BYTES = 64 << 20


class Growth(msgspec.Struct):
    """The core's resident memory over the last looks, as (monotonic ns, bytes), the oldest first."""

    _looks: deque[tuple[int, int]] = msgspec.field(default_factory=lambda: deque(maxlen=LOOKS_MAX))

    def look(self, at_ns: int, rss_bytes: int) -> None:
        """Note one look."""
        self._looks.append((at_ns, rss_bytes))

    def during(self, since_ns: int) -> int:
        """Return by how many bytes the core grew since then at most; 0 where no look tells."""
        after = [rss for at_ns, rss in self._looks if at_ns > since_ns]
        if not after:
            return 0
        before = [rss for at_ns, rss in self._looks if at_ns <= since_ns]
        return max(0, max(after) - (before[-1] if before else after[0]))

    def grew(self, note: CommandNote) -> bool:
        """Return whether the core grew during this command by more than a healthy one needs."""
        return self.during(note.started_ns) >= GREW_BYTES
