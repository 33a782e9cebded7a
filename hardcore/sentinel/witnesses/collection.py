"""The witness of the garbage collection: does the core say that it collects memory right now?

A full collection over a large heap stops both beats for seconds in a healthy process, and the core announces
it. A look that finds one running, or just over, is no look at the hang that may stand behind it: what was
burned in that interval is charged to the collection. Nobody is excused for ever by this: what both together
may burn has a limit of its own.
"""

import msgspec

from hardcore.model.recorder import Beats
from hardcore.model.verdicts import Colour, Testimony
from hardcore.sentinel.lasting import NS_PER_MS


class CollectionFacts(msgspec.Struct, frozen=True):
    """`touched`: a collection ran in the interval that this look ends. `for_ns`: how long it has run by now."""

    touched: bool = False
    running: bool = False
    for_ns: int = 0


class Collection(msgspec.Struct):
    """Remembers whether the last look found one running."""

    _ran: bool = False

    def look(self, beats: Beats, at_ns: int) -> CollectionFacts:
        """Take in one look."""
        ran, runs = self._ran, bool(beats.gc_since_ns)
        self._ran = runs
        return CollectionFacts(ran or runs, runs, max(0, at_ns - beats.gc_since_ns) if runs else 0)


def testify(facts: CollectionFacts) -> Testimony | None:
    """Return what the core says of its collection, or None if it says nothing."""
    if not facts.running:
        return None
    why = f"the core has been collecting memory for {facts.for_ns // NS_PER_MS} ms"
    return Testimony("collection", Colour.GREEN, why)
