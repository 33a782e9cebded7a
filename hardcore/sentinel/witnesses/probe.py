"""The witness of the probe: does the core answer when it is asked for its health over its own socket?

A slow answer is what a loaded server looks like, so silence counts only while nothing else shows life: no
command is completed, yet the loop's beats are fresh. Whatever moves begins the count anew.
"""

import msgspec

from hardcore.model.observations import Probed
from hardcore.model.recorder import Beats
from hardcore.model.verdicts import Colour, Testimony
from hardcore.sentinel.lasting import NS_PER_MS
from hardcore.sentinel.seen_time import SeenTime

#: One that is not answered is no news.
PROBES_MIN = 2


class Unanswered(msgspec.Struct, frozen=True):
    """Probes in a row without an answer: how many, for how long (ns, as far as we were there), since when."""

    probes: int
    for_ns: int
    since_ns: int


class Probe(msgspec.Struct):
    """Remembers the probes in a row that were not answered."""

    _probes: int = 0
    _since_ns: int = 0
    _until_ns: int = 0
    _completed: int = -1
    _quiet_ns: int = 0

    def hear(self, fact: Probed) -> None:
        """Take in one probe; one that was asked before the last sign of life says nothing."""
        if fact.answered:
            self._probes, self._quiet_ns = 0, max(self._quiet_ns, fact.at_ns)
        elif fact.asked_ns >= self._quiet_ns:
            self._since_ns = self._since_ns if self._probes else fact.asked_ns
            self._until_ns = fact.at_ns
            self._probes += 1

    def look(self, beats: Beats | None, seen: SeenTime, *, excused: bool = False) -> Unanswered | None:
        """Take in one look. `excused`: there is another reason for silence, or none of ours to conclude from it.

        No beats: the page tells nothing, so only an answer is a sign of life.
        """
        completed = self._completed if beats is None else beats.completed
        if excused or completed != self._completed or seen.begins_anew:
            self._completed, self._quiet_ns, self._probes = completed, seen.at_ns, 0
        if not self._probes:
            return None
        # It is known to have been silent until the last probe was given up: since then nobody has asked.
        for_ns = seen.between(self._since_ns, self._until_ns)
        return Unanswered(self._probes, for_ns, self._since_ns)


def testify(found: Unanswered | None) -> Testimony | None:
    """Return what the probe says: one that is not answered is no news yet."""
    if found is None or found.probes < PROBES_MIN:
        return None
    why = f"{found.probes} probes in a row were not answered, for {found.for_ns // NS_PER_MS} ms"
    return Testimony("probe", Colour.YELLOW, why)
