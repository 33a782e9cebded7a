"""Rows under suspicion: a row that was being booked when a core died waits for its trial, and its file waits behind it.

Nobody else has the row, so the importer files its case for the court (`docs/wires.md` section 14): what it is called and where
it stands, for the court reads the kept file by itself. Written whole or not at all, and again by the next life if this one
dies. What becomes of it is read where everything is read, in the rules: a name that is no suspect any more may be booked,
unless a letter has it, and then the ledger's own door refuses it. Not chosen: to skip it and come back; rows keep their order.
"""

import datetime as dt
import json
import logging
import os
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Final

from core.rulings import Rulings

VERSION: Final = 1
UNFINISHED: Final = ".new"

logger = logging.getLogger("core.imports")


class Suspected:
    """The suspects as the importer sees them."""

    def __init__(
        self, rulings: Rulings | None = None, tell: Callable[[str], object] = lambda _name: None
    ) -> None:
        """Go by these rules, as they stand at each moment. `tell` is told the name of each case that was filed."""
        self._rulings = rulings or Rulings()
        self._tell = tell

    @property
    def any(self) -> bool:
        """Whether anything is under suspicion."""
        return bool(self._rulings.quarantine.rules.suspects)

    def holds(self, name: str) -> bool:
        """Whether what has this name waits for its trial."""
        return name in self._rulings.quarantine.rules.suspects

    def look_again(self) -> None:
        """Read the rules anew: they may have changed between the opening of the book and now. Blocks."""
        fault = self._rulings.quarantine.read()
        if fault is not None:
            logger.warning("The rules before stay in force. %s", fault.why)

    def file(self, name: str, key: str, import_id: str, ordinal: int) -> bool:
        """File the case of a row and say so; False where it can't be written now. Blocks."""
        if self._rulings.cases is None:
            return True
        case = {
            "version": VERSION,
            "name": name,
            "at": dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z"),
            "source": f"import:{import_id}",
            "key": key,
            "digest": sha256(key.encode()).hexdigest(),
            "case": {"name": name, "row": {"import": import_id, "ordinal": ordinal}},
        }
        try:
            _write(self._rulings.cases / f"{name}.json", json.dumps(case).encode())
        except OSError as error:
            logger.warning(
                "The case of row %d of import %s can't be filed: %s", ordinal, import_id, error.strerror
            )
            return False
        self._tell(name)
        return True


def _write(path: Path, content: bytes) -> None:
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    fresh = path.with_name(path.name + UNFINISHED)
    with fresh.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    fresh.rename(path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
