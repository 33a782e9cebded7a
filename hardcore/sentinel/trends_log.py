"""Whether the log says more than it usually does: errors and warnings in a stretch, against the stretches before.

A log has no limit that it could reach, so there is no slope here: what is told is that the newest stretches all lie
far above what was usual, which is often the first that can be seen of something that will fail later. The usual is a
high one of the past, not the middle: a program that complains every hour complains every hour.
"""

from collections import deque

import msgspec

from hardcore.sentinel.trends_slope import POINTS_MIN

#: So many stretches are kept.
KEPT_MAX = 240
#: More than so many times the usual, and more than so many in a stretch, is more than usual.
TIMES, MORE_MIN = 3, 10
#: The usual is what all but one in twenty stretches stay below.
USUAL_SHARE = 0.95


class Chatter(msgspec.Struct):
    """What was written in each stretch of one life, the oldest first. `step_ns`: how long a stretch is."""

    step_ns: int
    from_ns: int = 0
    number: int | None = None  # of the open stretch
    begun_with: int = 0  # what was counted when it began
    counts: deque[int] = msgspec.field(default_factory=lambda: deque(maxlen=KEPT_MAX))
    told: bool = False

    def look(self, at_ns: int, counted: int) -> bool:
        """Note what was written so far; return whether a stretch has ended by it."""
        if at_ns < self.from_ns:
            return False
        number = at_ns // self.step_ns
        ended = self.number is not None and number > self.number
        if ended:
            self.counts.append(max(0, counted - self.begun_with))
        if self.number is None or ended:
            self.number, self.begun_with = number, counted
        return ended

    def excess(self, confirm_ns: int) -> tuple[int, int] | None:
        """Return the least of the newest stretches and what they are measured against, if all of them lie above it."""
        newest = max(1, confirm_ns // self.step_ns)
        past = sorted(tuple(self.counts)[:-newest])
        if len(past) < POINTS_MIN:
            return None
        limit = max(MORE_MIN, TIMES * past[int(USUAL_SHARE * (len(past) - 1))])
        least = min(tuple(self.counts)[-newest:])
        return (least, limit) if least > limit else None
