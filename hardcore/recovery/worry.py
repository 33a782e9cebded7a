"""When worry is worth showing: DEGRADED after a second of yellow, and back after ten of green.

Without the two delays every hiccup would flicker on the page; the verdict itself is not delayed by them.
"""

import msgspec

from hardcore.model.verdicts import Colour
from hardcore.recovery.budget import NS_PER_MS


class Worry(msgspec.Struct):
    """Remembers since when the verdict has not been green. `shown`: people are told DEGRADED."""

    after_ms: int
    clean_ms: int
    shown: bool = False
    _since_ns: int | None = None
    _last_ns: int = 0

    def look(self, colour: Colour, now_ns: int) -> None:
        """Take in one verdict's colour."""
        if colour is Colour.GREEN:
            self._since_ns = None
            self.shown = self.shown and now_ns - self._last_ns < self.clean_ms * NS_PER_MS
            return
        self._last_ns = now_ns
        if self._since_ns is None:
            self._since_ns = now_ns
        self.shown = self.shown or now_ns - self._since_ns >= self.after_ms * NS_PER_MS

    def forget(self) -> None:
        """Begin anew: another core is another matter."""
        self.shown, self._since_ns = False, None
