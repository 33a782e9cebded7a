"""The time that we were there to see: what every length of time that speaks against a core is measured in.

A guard that comes late was away, and so, maybe, was everybody else: a machine that was paused, a container that was
frozen, a processor shared by too many. That time is nobody's. But it is only the time we missed that must not count,
not what was seen before it: a guard that began anew with each late look would never judge at all on a machine that
is always late. So a gap between two looks counts in full when the second came in time, and as one interval, the
time that two looks ordinarily vouch for, when it came late.
"""

from bisect import bisect_right

import msgspec

#: Gaps remembered; what was before the oldest one forgotten counts for nothing.
GAPS_MAX = 512


class SeenTime(msgspec.Struct):
    """Remembers what was missed. All in monotonic ns; `before_ns` is the look before the one at `at_ns`.

    Nothing before `floor_ns` counts.
    """

    interval_ns: int
    at_ns: int = 0
    before_ns: int = 0
    floor_ns: int = 0
    _missed_from_ns: list[int] = msgspec.field(default_factory=list)
    _missed_to_ns: list[int] = msgspec.field(default_factory=list)

    def look(self, at_ns: int, *, late: bool) -> None:
        """Note a look. `late`: it came so late that most of the time since the last one was not seen."""
        if not self.at_ns:
            self.floor_ns = self.at_ns = at_ns
        self.before_ns, self.at_ns = self.at_ns, at_ns
        if late and at_ns - self.interval_ns > self.before_ns:
            self._miss(self.before_ns, at_ns - self.interval_ns)

    def forgive(self) -> None:
        """Let nothing count that was before this look: the machine was away, whatever our ticks say."""
        self.floor_ns = self.at_ns
        self._missed_from_ns.clear()
        self._missed_to_ns.clear()

    @property
    def begins_anew(self) -> bool:
        """Whether nothing counts that was before this look."""
        return self.floor_ns >= self.at_ns

    @property
    def gap_ns(self) -> int:
        """How much was seen since the look before."""
        return self.since(self.before_ns)

    def since(self, from_ns: int) -> int:
        """Return how much of the time from `from_ns` to this look was seen; 0 for what is yet to come."""
        from_ns = max(from_ns, self.floor_ns)
        return max(0, self.at_ns - from_ns - self._missed_since(from_ns))

    def between(self, from_ns: int, to_ns: int) -> int:
        """Return how much of the time from `from_ns` to `to_ns` was not missed, whenever it was."""
        return max(0, to_ns - from_ns - (self._missed_since(from_ns) - self._missed_since(to_ns)))

    def _missed_since(self, from_ns: int) -> int:
        if not self._missed_to_ns:  # as at every look of a guard that is in time
            return 0
        first = bisect_right(self._missed_to_ns, from_ns)
        gaps = zip(self._missed_from_ns[first:], self._missed_to_ns[first:], strict=True)
        return sum(end_ns - max(from_ns, began_ns) for began_ns, end_ns in gaps)

    def _miss(self, from_ns: int, to_ns: int) -> None:
        self._missed_from_ns.append(from_ns)
        self._missed_to_ns.append(to_ns)
        if len(self._missed_to_ns) > GAPS_MAX:
            self.floor_ns = max(self.floor_ns, self._missed_to_ns.pop(0))
            self._missed_from_ns.pop(0)
