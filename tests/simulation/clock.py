"""Simulated time: a heap of deeds, and a number that jumps to the next one.

Nothing happens between two deeds, so nothing is computed there: an hour of quiet costs one jump. Deeds of
the same moment run in the order in which they were planned, which makes a run a function of its seed.
"""

import heapq
from collections.abc import Callable

Deed = Callable[[], object]

NS_PER_MS = 1_000_000
NS_PER_S = 1_000_000_000


class Clock:
    """`now_ns` is monotonic; it starts well above zero, because zero means "never" on a recorder page."""

    __slots__ = ("_heap", "_planned", "now_ns")

    def __init__(self) -> None:
        self.now_ns = 1_000 * NS_PER_S
        self._heap: list[tuple[int, int, Deed]] = []
        self._planned = 0

    def at(self, when_ns: int, deed: Deed) -> None:
        """Plan a deed; one for a moment that is over runs as soon as possible."""
        self._planned += 1
        heapq.heappush(self._heap, (when_ns, self._planned, deed))

    def after(self, wait_ns: int, deed: Deed) -> None:
        """Plan a deed `wait_ns` from now."""
        self.at(self.now_ns + wait_ns, deed)

    def leap(self, gap_ns: int) -> None:
        """Let `gap_ns` pass in which nobody could do anything: whatever was planned in it comes late."""
        self.now_ns += gap_ns

    def step(self) -> bool:
        """Go to the next deed and do it; False when nothing is planned any more."""
        if not self._heap:
            return False
        when_ns, _, deed = heapq.heappop(self._heap)
        self.now_ns = max(self.now_ns, when_ns)
        deed()
        return True
