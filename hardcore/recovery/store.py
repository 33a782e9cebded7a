"""What the guard knows of the ledger's store without ever opening it.

A stalled disk must not stop the watch, so the guard never touches the ledger's files: it learns the epoch
and the last commit from what cores say and from the recorder pages they leave.
"""

from dataclasses import dataclass

from hardcore.model.recorder import Page, Witness


@dataclass(slots=True)
class StoreKnowledge:
    """The store's epoch and the last commit anybody saw.

    `certain` is False while a core that was started may have raised the epoch without living to say so. `witness` is
    what the core's own page shows; `passed_on` what the gateway saw on its way to a client, the other witness.
    """

    epoch: int | None = None
    certain: bool = False
    witness: Witness | None = None
    passed_on: Witness | None = None

    def forget(self) -> None:
        """Take the ledger as it stands: the operator has put another copy in its place and says so."""
        self.epoch, self.certain, self.witness, self.passed_on = None, False, None, None

    def witnesses(self) -> tuple[Witness, ...]:
        """Return the commits that the next core has to show: what a page proves, and what a client was told."""
        return tuple(seen for seen in (self.witness, self.passed_on) if seen is not None)

    def proven(self, witness: Witness) -> None:
        """A core has proven its ledger up to there: what was known before is part of that."""
        self.witness, self.passed_on = witness, None

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
        if page.witness is not None and (
            self.witness is None
            or (page.witness.seq, page.witness.epoch) >= (self.witness.seq, self.witness.epoch)
        ):
            self.witness = page.witness
