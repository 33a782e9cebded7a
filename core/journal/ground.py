"""The ground of a proof: from where in the book it goes on, and what it takes as proven before.

Three can be had: the last attestation in the store, a checkpoint beside it that is newer, or nothing, which means the
whole chain from the first event. The newest good one wins; it is said by which one a proof went. Not chosen: to trust a
checkpoint instead of looking at the chain behind it; a proof from any ground ends at the head and holds all balances
against it.
"""

import time

import msgspec
from sqlalchemy import Connection

from core.journal import checkpoint, queries
from core.journal.attestation import NOTHING, Attestation, attested_before
from core.journal.checkpoint import State, Trigger
from core.journal.checkpoints import Checkpoints


class Ground(msgspec.Struct):
    """From where to prove. `whole`: from the first event. `known`: what this very process has proven already.

    `gone_by`: the name of the checkpoint that the last proof began at, empty where it was none.
    """

    checkpoints: Checkpoints | None = None
    whole: bool = False
    known: Attestation | None = None
    gone_by: str = ""

    def base(self, connection: Connection, head_seq: int) -> Attestation | None:
        """Return what a proof begins at, in a book whose last event is `head_seq`; see `attested_before`."""
        self.gone_by = ""
        if self.whole:
            return NOTHING
        base = attested_before(queries.newest_attestation(connection), head_seq)
        if self.known is not None and self.known.seq <= head_seq and _is_after(self.known, base):
            base = self.known
        if self.checkpoints is None:
            return base
        found = self.checkpoints.newest(connection, time.time_ns()) if self.known is None else None
        if found is not None and _is_after(found.attested, base):
            self.gone_by = found.name
            self.checkpoints.note(found.name, checkpoint.after(State.COMPLETE, Trigger.USED))
            return found.attested
        return base


def _is_after(one: Attestation, other: Attestation | None) -> bool:
    return other is None or one.seq > other.seq
