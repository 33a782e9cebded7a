"""The trouble that a living core has and that a restart would not help: when it begins, and when it is over.

It is over when nothing has been said of it for `clean_after_ms`: a disk that is full, has room for a second and is
full again is one trouble, one incident and one report. A damaged ledger is not over because nobody speaks of it.
"""

import msgspec

from hardcore.model.verdicts import Diagnosis


class Troubles(msgspec.Struct):
    """What is wrong at present. Times are monotonic; `due_ns` is when it is over if nothing comes up."""

    clean_ns: int
    known: tuple[Diagnosis, ...] = ()
    lasting: bool = False
    due_ns: int | None = None

    @property
    def on(self) -> bool:
        """Whether there is a trouble."""
        return bool(self.known)

    def meets(self, diagnosis: Diagnosis) -> bool:
        """Note that this is wrong; return whether that is new."""
        self.due_ns = None
        if diagnosis in self.known:
            return False
        self.known += (diagnosis,)
        self.lasting = self.lasting or diagnosis is Diagnosis.STORE_CORRUPT
        return True

    def look(self, now_ns: int, *, quiet: bool) -> None:
        """Note whether all is quiet at this moment."""
        if not self.on or self.lasting or not quiet:
            self.due_ns = None
        elif self.due_ns is None:
            self.due_ns = now_ns + self.clean_ns

    def clear(self) -> None:
        """It is over."""
        self.known, self.lasting, self.due_ns = (), False, None
