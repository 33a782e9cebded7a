"""The witness of the clocks: did the machine sleep, was the wall's clock set?

While a machine is suspended, the clock that counts its sleep goes on and the monotonic one stands still: our
ticks look on time, and yet peers, sockets and disks were away. So everybody gets fresh deadlines once. The
wall's clock judges nothing here, whatever it shows: that it was set is only told.
"""

import msgspec

from hardcore.model.clocks import Clocks
from hardcore.model.verdicts import Colour, Testimony

#: The two clocks are read one after the other: a smaller difference is ours.
SLEPT_NS = 500_000_000
JUMPED_NS = 1_000_000_000


class ClockFacts(msgspec.Struct, frozen=True):
    """How long the machine slept between the last two looks, and by how much the wall was set meanwhile (ns)."""

    slept_ns: int = 0
    jumped_ns: int = 0


class ClockWatch(msgspec.Struct):
    """Remembers how the clocks stood against each other."""

    _slept_ns: int | None = None
    _wall_ns: int | None = None

    def look(self, clocks: Clocks | None, at_ns: int) -> ClockFacts:
        """Take in one look; None: nobody read the clocks."""
        if clocks is None:
            return ClockFacts()
        slept_ns, wall_ns = clocks.boot_ns - at_ns, clocks.wall_ns - clocks.boot_ns
        before_slept, self._slept_ns = self._slept_ns, slept_ns
        before_wall, self._wall_ns = self._wall_ns, wall_ns
        if before_slept is None or before_wall is None:
            return ClockFacts()
        slept, jumped = slept_ns - before_slept, wall_ns - before_wall
        return ClockFacts(
            slept if slept >= SLEPT_NS else 0,
            jumped if abs(jumped) >= JUMPED_NS else 0,
        )


def testify(facts: ClockFacts) -> Testimony | None:
    """Return what the clocks say, or None if they agree."""
    if facts.slept_ns:
        seconds = facts.slept_ns / 1e9
        return Testimony("clocks", Colour.YELLOW, f"the machine slept for {seconds:.1f} s")
    if facts.jumped_ns:
        seconds = facts.jumped_ns / 1e9
        return Testimony("clocks", Colour.GREEN, f"the wall's clock was set by {seconds:+.1f} s")
    return None
