"""Restart intensity per period, and the pause between two tries.

A sliding window, not a fixed one: five deaths just before a window's edge and five just after it are ten.
The idea is OTP's `add_restart`: drop what is older than the period, add now, compare. The pause doubles
with each try that never became ready; a core that has proven itself is replaced at once.
"""

import msgspec

NS_PER_MS = 1_000_000
NS_PER_S = 1_000_000_000


class Budget(msgspec.Struct, frozen=True):
    """Deaths that count: `limit` of them in `window_ns` are allowed. Times are monotonic."""

    limit: int
    window_ns: int
    deaths_ns: tuple[int, ...] = ()

    def at(self, now_ns: int) -> "Budget":
        """Return this budget without the deaths that have left the window by `now_ns`.

        A stamp from the future can't be right (another boot's clock); it counts as fresh and ages from now.
        """
        if not self.deaths_ns:
            return self
        kept = tuple(min(t, now_ns) for t in self.deaths_ns if now_ns - t < self.window_ns)
        return Budget(self.limit, self.window_ns, kept)

    def after_death(self, now_ns: int) -> "Budget":
        """Return this budget with one more death."""
        trimmed = self.at(now_ns)
        return Budget(self.limit, self.window_ns, (*trimmed.deaths_ns, now_ns))

    def without(self, death_ns: int) -> "Budget":
        """Return this budget without the death of that moment: what caused it is known, and can't do it again."""
        return Budget(self.limit, self.window_ns, tuple(t for t in self.deaths_ns if t != death_ns))

    def spent(self, now_ns: int) -> bool:
        """Return whether more deaths than allowed lie in the window."""
        return len(self.at(now_ns).deaths_ns) > self.limit


def backoff_ns(tries: int, initial_ms: int, max_ms: int, jitter: float) -> int:
    """Return the pause before the next start after `tries` starts in a row that proved nothing.

    Doubles from `initial_ms` up to `max_ms`; `jitter` (0 to 1, given by the caller) takes away up to a
    quarter, so that two machines that fell together don't rise together.
    """
    assert tries >= 1, "a first start has no pause"
    pause_ms = min(max_ms, initial_ms * 2 ** min(tries - 1, 30))
    return int(pause_ms * (1 - 0.25 * jitter) * NS_PER_MS)
