"""The witness of the answers: does the core answer what it has not committed?

A core stores the witness of a commit before the first answer that claims it, so the highest sequence answered
is never above the highest one witnessed; only a page read in the middle can look like it, for one look. A core of
which it stays true says "done" and does nothing. Until this life has committed anything there is no witness to
compare with: then what it says of its own head when asked for its health is taken, if it says it later.
"""

import msgspec

from hardcore.model.observations import Probed
from hardcore.model.recorder import Beats, Witness
from hardcore.model.verdicts import Colour, Testimony
from hardcore.sentinel.lasting import NS_PER_MS, Lasting
from hardcore.sentinel.seen_time import SeenTime


class Unkept(msgspec.Struct, frozen=True):
    """A claim that nothing stands behind: the sequences, for how long (ns), since when."""

    answered_seq: int
    committed_seq: int
    for_ns: int
    since_ns: int


class Answers(msgspec.Struct):
    """Remembers since when more was answered than committed."""

    _head: int | None = None
    _claimed: int = 0
    _claimed_ns: int = 0
    _lasting: Lasting = msgspec.field(default_factory=Lasting)

    def hear(self, fact: Probed) -> None:
        """Take in what the core says of its head; what was asked before a claim says nothing about it."""
        if fact.seq is not None and fact.asked_ns >= self._claimed_ns:
            self._head = fact.seq

    def look(self, beats: Beats, witness: Witness | None, seen: SeenTime) -> Unkept | None:
        """Take in one look; return the claim that is not kept, or None."""
        if beats.answered_seq != self._claimed:
            self._claimed, self._claimed_ns, self._head = beats.answered_seq, seen.at_ns, None
        known = [seq for seq in (witness.seq if witness else None, self._head) if seq is not None]
        unkept = bool(known) and beats.answered_seq > max(known)
        for_ns = self._lasting.look(unkept, seen)
        if not unkept:
            return None
        return Unkept(beats.answered_seq, max(known), for_ns, self._lasting.since_ns)


def testify(unkept: Unkept | None, limit_ms: int) -> Testimony | None:
    """Return what is claimed and not there; yellow from `limit_ms` on."""
    if unkept is None or unkept.for_ns < limit_ms * NS_PER_MS:
        return None
    why = (
        f"event {unkept.answered_seq} was answered as committed; "
        f"the last one committed is {unkept.committed_seq}, for {unkept.for_ns // NS_PER_MS} ms"
    )
    return Testimony("answers", Colour.YELLOW, why)
