"""What the guard knows of the ledger's store without ever opening it.

A stalled disk must not stop the watch, so the guard never touches the ledger's files: it learns the epoch
and the last commit from what cores say and from the recorder pages they leave.
"""

import msgspec

from hardcore.model.recorder import LifeState, Page, Witness


class StoreKnowledge(msgspec.Struct):
    """The store's epoch and the last commit anybody saw.

    `certain` is False while a core that was started may have raised the epoch without living to say so. `witness` is
    what the core's own page shows; `passed_on` what the gateway saw on its way to a client, the other witness.
    """

    epoch: int | None = None
    certain: bool = False
    witness: Witness | None = None
    passed_on: Witness | None = None
    proven: Witness | None = None  # where the ledger ended when the last core proved it
    served: int | None = None  # the epoch of the last core that served; 0: no word of any that served counts
    doubtful: Witness | None = None  # passed on by a core that no page tells of

    def forget(self) -> None:
        """Take the ledger as it stands: the operator has put another copy in its place and says so."""
        self.epoch, self.certain, self.served = None, False, 0
        self.witness = self.passed_on = self.proven = self.doubtful = None

    def raised(self, epoch: int) -> None:
        """A core has raised the epoch."""
        self.epoch, self.certain = epoch, True
        self.reaches(epoch)

    def reaches(self, epoch: int) -> None:
        """Decide on a commit that was passed on by a core which left no page, now that a core has raised the epoch.

        It is this ledger's if that core came between. Of a ledger that was put back the gateway remembers an epoch that
        this one has not reached.
        """
        doubtful, self.doubtful = self.doubtful, None
        if doubtful is not None and self.proven is None and 0 < (self.served or 0) < doubtful.epoch < epoch:
            self.told(doubtful)

    def witnesses(self) -> tuple[Witness, ...]:
        """Return the commits that the next core has to show: what a page proves, and what a client was told."""
        return tuple(seen for seen in (self.witness, self.passed_on) if seen is not None)

    def is_proven(self, witness: Witness) -> None:
        """A core has proven its ledger up to there: what was known before is part of that, if it is no later."""
        self.witness = self.proven = witness
        self.served = witness.epoch
        if not self.misses(witness.seq):
            self.passed_on = None

    def misses(self, seq: int) -> bool:
        """Return whether a ledger that ends there lacks what a client was told of: it was heard of too late to ask."""
        return self.passed_on is not None and self.passed_on.seq > seq

    def lacks(self, witness: Witness) -> bool:
        """Return whether a commit of an earlier epoch was passed on that the ledger did not have when it was proven."""
        last = self.proven
        return last is not None and witness.epoch < last.epoch and witness.seq > last.seq

    def knows(self, witness: Witness) -> bool:
        """Return whether this commit is the last serving core's: of a ledger that was put back it would tell no truth.

        Where no page says which core that was, it is the only witness left.
        """
        return self.served is None or witness.epoch == self.served

    def doubts(self, witness: Witness) -> None:
        """Keep a commit of which the next epoch says whether it is this ledger's."""
        if self.doubtful is None or witness.seq > self.doubtful.seq:
            self.doubtful = witness

    def told(self, witness: Witness) -> None:
        """The gateway has passed this commit on to a client."""
        if self.passed_on is None or witness.seq > self.passed_on.seq:
            self.passed_on = witness

    def saw(self, page: Page | None) -> None:
        """Take over what a recorder page proves; an older core's page proves nothing new."""
        if page is None:
            return
        if page.beats.epoch and page.beats.epoch >= (self.epoch or 0):
            self.epoch, self.certain = page.beats.epoch, True
            # One that died behind its fence and before its proof has served nobody.
            served = page.beats.state not in {LifeState.STARTING, LifeState.SPARE}
            self.served = page.beats.epoch if self.proven is None and served else self.served
        self.shown(page.witness)

    def shown(self, witness: Witness | None) -> None:
        """Take over what a page shows of the last commit; an earlier one proves nothing new.

        A living core's counts as well: one that is killed and does not die leaves no other.
        """
        known = self.witness
        if witness is not None and (
            known is None or (witness.seq, witness.epoch) >= (known.seq, known.epoch)
        ):
            self.witness = witness
