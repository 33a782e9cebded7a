"""Rows under suspicion: a row that was being booked when a core died waits for its trial, and its file waits behind it.

Nobody else has the row, so the importer files its case for the court (`docs/wires.md` section 14): what it is called and where
it stands, for the court reads the kept file by itself. Written whole or not at all, and again by the next life if this one
dies. All suspects of a wave are filed together and said in one word, so that one court, with one copy of the ledger, tries them. What becomes of it is read where everything is read, in the rules: a name that is no suspect any more may be booked,
unless a letter has it, and then the ledger's own door refuses it. Not chosen: to skip it and come back; rows keep their order.
"""

import logging
from collections.abc import Callable, Sequence
from typing import Final

import msgspec

from core.cases import Case, file_cases
from core.imports.states import Waiting
from core.rulings import Rulings

SOURCE: Final = "import:"  # and the id of one: as whom a case, and a source that is stopped, name it

logger = logging.getLogger("core.imports")


class HeldRow(msgspec.Struct, frozen=True):
    """A row that waits for its trial: what it is called, its key in the ledger, and its place in its file, from 1."""

    name: str
    key: str
    import_id: str
    ordinal: int


class Suspected:
    """The suspects as the importer sees them."""

    def __init__(
        self, rulings: Rulings | None = None, tell: Callable[[Sequence[str]], object] = lambda _names: None
    ) -> None:
        """Go by these rules, as they stand at each moment. `tell` is told the names of the cases that were filed."""
        self._rulings = rulings or Rulings()
        self._tell = tell

    @property
    def any(self) -> bool:
        """Whether anything is under suspicion."""
        return bool(self._rulings.quarantine.rules.suspects)

    def holds(self, name: str) -> bool:
        """Whether what has this name waits for its trial."""
        return name in self._rulings.quarantine.rules.suspects

    def halts(self, import_id: str, name: str, wall_ns: int) -> Waiting | None:
        """Return why an import whose next row has this name can't go on at this moment of wall time; None: it can."""
        rules = self._rulings.quarantine.rules
        if rules.sources.get(SOURCE + import_id, 0) > wall_ns:
            return Waiting.SOURCE_STOPPED
        return Waiting.TRIAL if name in rules.suspects else None

    @property
    def is_named(self) -> bool:
        """Whether all suspects are known, as far as anybody will say them."""
        return self._rulings.word.is_said

    def look_again(self) -> None:
        """Read the rules anew: they may have changed between the opening of the book and now. Blocks."""
        fault = self._rulings.quarantine.read()
        if fault is not None:
            logger.warning("The rules before stay in force. %s", fault.why)

    def file(self, rows: Sequence[HeldRow]) -> bool:
        """File the cases of these rows and say so of all at once; False where that can't be done now. Blocks.

        One that lies there already is only said again: whoever was told of it may be gone.
        """
        if self._rulings.cases is None:
            return True
        try:
            file_cases(self._rulings.cases, [_case_of(row) for row in rows])
        except OSError as error:
            logger.warning("The cases of %d rows of an import can't be filed: %s", len(rows), error.strerror)
            return False
        self._tell([row.name for row in rows])
        return True


def _case_of(row: HeldRow) -> Case:
    return Case(
        row.name, row.key, SOURCE + row.import_id, {"row": {"import": row.import_id, "ordinal": row.ordinal}}
    )
