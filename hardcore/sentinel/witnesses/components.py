"""The witness of the parts: does each one that has work to do go on with it?

Each part of the core beats by itself and says how long it may be silent. The table of parts is read less often than
the beats, so what was found stands until it is read again: an age that is counted on in between would call a part late
that has beaten since. Two readings must find the same beat, and only time that we were there to see counts.
"""

import msgspec

from hardcore.model.recorder import ComponentBeat
from hardcore.model.verdicts import Colour, Testimony
from hardcore.sentinel.lasting import NS_PER_MS
from hardcore.sentinel.seen_time import SeenTime


class Stalled(msgspec.Struct, frozen=True):
    """A part that has work and has been silent for `for_ns`, since `since_ns`; `limit_ns` is what it may be."""

    name: str
    for_ns: int
    since_ns: int
    limit_ns: int


class Components(msgspec.Struct):
    """Remembers the last beat of each part, and what was found at the last reading."""

    _beats: dict[str, int] = msgspec.field(default_factory=dict)
    _found: Stalled | None = None

    def look(self, parts: tuple[ComponentBeat, ...], seen: SeenTime) -> Stalled | None:
        """Return the part that has been silent for longest beyond its limit, or None."""
        if not parts:
            return self._found
        found = [one for one in (self._silent(part, seen) for part in parts) if one is not None]
        self._beats = {part.name: part.beat_ns for part in parts}
        self._found = max(found, key=lambda one: one.for_ns - one.limit_ns, default=None)
        return self._found

    def _silent(self, part: ComponentBeat, seen: SeenTime) -> Stalled | None:
        if not (part.since_ns and part.limit_ns) or self._beats.get(part.name) != part.beat_ns:
            return None
        since_ns = max(part.beat_ns, part.since_ns)
        for_ns = seen.since(since_ns)
        return Stalled(part.name, for_ns, since_ns, part.limit_ns) if for_ns > part.limit_ns else None


def testify(found: Stalled | None) -> Testimony | None:
    """Return which part stands still, or None."""
    if found is None:
        return None
    why = f"the part {found.name} has work and has been silent for {found.for_ns // NS_PER_MS} ms"
    return Testimony("parts", Colour.YELLOW, why)
