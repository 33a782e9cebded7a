"""The proof ahead: a spare walks along the chain while it waits, so that little is left to prove when it is needed.

Hashing the ten thousand events that may lie between two attestations takes some tens of milliseconds, and they would
all lie between a death and the first answer. Here they are read in slices, each a short read of the caller's, and what was
seen whole is remembered with its hash: at the promotion the proof goes on from there, after a look whether that event
still stands. What it rests on is what any proof before serving rests on, the last attestation: a walk that fell behind
one begins anew from it. Not chosen: to keep the balances too, event by event; what is listed as posted is added up by
the store in a fraction of the time.
"""

from collections.abc import Sequence
from typing import Final

from sqlalchemy import Connection

from core.journal import queries
from core.journal.chain import Broken
from core.journal.ground import Ground
from core.journal.proof import Tail, Walk, Witness
from core.journal.rebuilding import Rebuilding

SLICE_EVENTS: Final = 500


class Ahead:
    """What this process has seen of the chain so far. One thread at a time.

    `fault`: where the chain broke. It stays so: an attestation that the writer has made since says nothing of what
    lies before it.
    """

    def __init__(
        self, tail_events: int, rebuilding: Rebuilding | None = None, ground: Ground | None = None
    ) -> None:
        """Begin; nothing is read yet. `tail_events`: how far back a book is seen that was never attested.

        `ground`: from where it is seen; absent: from the last attestation.
        """
        self._tail_events = tail_events
        self._rebuilding = rebuilding or Rebuilding()
        self._ground = ground or Ground()
        self._walk: Walk | None = None
        self.fault: Broken | None = None

    @property
    def seq(self) -> int:
        """The last event that was seen whole, 0 without one."""
        return self._walk.seq if self._walk else 0

    def follow(self, connection: Connection) -> bool:
        """Take the next slice of the chain; return whether the head was met, or nothing is left to be seen.

        `connection` sees the book at one moment, which ends soon after this returns: a transaction of the caller's.
        Whoever is told False asks again after a short rest. An error of the store is raised, and changes nothing.
        """
        if self.fault is not None:
            return True
        head = queries.head(connection)
        walk = self._going_on(connection, head.head_seq)
        if isinstance(walk, Broken):
            self.fault = walk
            return True
        first, last = walk.seq + 1, min(walk.seq + SLICE_EVENTS, head.head_seq)
        rows = list(queries.event_rows(connection, walk.seq, SLICE_EVENTS))
        keys = queries.keys_between(connection, first, last)
        moved = queries.moved_between(connection, first, last)
        for row in self._rebuilding.over(rows):
            self.fault = self.fault or walk.take(row, keys)
        walk.post(moved)
        self._walk = None if self.fault else walk
        return self.fault is not None or walk.seq >= head.head_seq or not rows

    def tail(self, connection: Connection, witnesses: Sequence[Witness]) -> Tail | Broken:
        """Return what is left to be proven, read in the transaction that is open on `connection`.

        The proof takes the walk along: nothing may be asked of this object afterwards.
        """
        if self.fault is not None:
            return self.fault
        head = queries.head(connection)
        walk = self._walk or self._begun(connection, head.head_seq)
        if isinstance(walk, Broken):
            return walk
        return queries.read_tail(connection, walk, [witness.seq for witness in witnesses])

    def _going_on(self, connection: Connection, head_seq: int) -> Walk | Broken:
        """Return the walk, begun anew where a later attestation is nearer than its own way to the head."""
        walk = self._walk
        if walk is None:
            return self._begun(connection, head_seq)
        newest = queries.newest_attestation(connection)
        if newest is None or self._ground.whole or (walk.base is not None and newest.seq <= walk.base.seq):
            return walk
        if 0 < newest.seq - walk.seq <= SLICE_EVENTS:
            return walk  # on its way: it goes through the attested event
        begun = self._begun(connection, head_seq)
        if isinstance(begun, Walk):
            begun.checked = walk.checked
        return begun

    def _begun(self, connection: Connection, head_seq: int) -> Walk | Broken:
        """Begin a walk at its ground; in a book without one at its first event, or not too far back."""
        base = self._ground.base(connection, head_seq)
        start = base.seq if base is not None else max(0, head_seq - self._tail_events)
        last = queries.event_row(connection, start) if start else None
        if start and last is None:
            return Broken(start, f"event {start} is missing")
        if base is not None and last is not None and last.hash != base.hash:
            return Broken(start, f"event {start} is not the one that was attested under this number")
        return Walk(base, last)
