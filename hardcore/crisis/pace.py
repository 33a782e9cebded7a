"""How slow a client may be: patience that is earned by bytes. Pure.

A limit on silence alone is no limit: one byte every nine seconds is never silent, and a body sent so takes its place
in the waiting room for years. So whoever sends or takes a body has some patience to begin with, uses it up as time
goes by, and earns it back with what moves. A limit on the whole time was not chosen: a large upload over a poor line
is honest.
"""

NS_PER_MS = 1_000_000


class Pace:
    """The patience with one client. Times are monotonic nanoseconds."""

    __slots__ = ("_full_ms", "_left_ms", "_ms_per_byte", "_since_ns")

    def __init__(self, patience_ms: int, bytes_per_s_min: int) -> None:
        self._full_ms = float(patience_ms)
        self._ms_per_byte = 1000 / bytes_per_s_min
        self._left_ms = self._full_ms
        self._since_ns = 0

    def begin(self, now_ns: int) -> None:
        """A body begins."""
        self._left_ms, self._since_ns = self._full_ms, now_ns

    def go_on(self, now_ns: int) -> None:
        """The client may send again: the time in which it could not does not count."""
        self._since_ns = now_ns

    def moved(self, count: int) -> None:
        """So many bytes came."""
        self._left_ms = min(self._full_ms, self._left_ms + count * self._ms_per_byte)

    def left_ms(self, now_ns: int) -> float:
        """How much is left now."""
        self._left_ms = max(0.0, self._left_ms - (now_ns - self._since_ns) / NS_PER_MS)
        self._since_ns = now_ns
        return self._left_ms


def takes(unsent_before: int, unsent_now: int, waited_ms: int, bytes_per_s_min: int) -> bool:
    """Whether a client that was given `waited_ms` to take what waits for it took enough of it."""
    enough = min(unsent_before, waited_ms * bytes_per_s_min // 1000)
    return unsent_now > 0 and unsent_before - unsent_now >= max(1, enough)
