"""Rulings: what the guard has said of this ledger's commands and events, and what it has armed for a drill.

One value that is made once and handed to whoever has to go by it: the writer, the proofs, the importer, the service. A core
that nobody guards has one too, and it is empty. Not chosen: a look at the files wherever they matter; two parts of one
core could then go by two of them.
"""

from pathlib import Path
from typing import Final

import msgspec

from core.guarded.poison import FILE, Armoury
from core.guarded.quarantine import Quarantine, Unreadable
from core.journal.rebuilding import Rebuilding

RULES: Final = "state/quarantine.json"  # in a data folder: where its guard writes them
CASES: Final = "cases"  # beside the rules: where a suspect's case is filed


class Rulings(msgspec.Struct, frozen=True):
    """The rules in force and what is armed. `cases`: where cases are filed; None: nobody would read one."""

    quarantine: Quarantine = msgspec.field(default_factory=Quarantine)
    armoury: Armoury = msgspec.field(default_factory=Armoury)
    cases: Path | None = None

    @classmethod
    def beside(cls, path: Path | None) -> "Rulings":
        """Return the rulings of a guard whose file of rules is `path`, not read yet; None: there is no guard."""
        if path is None:
            return cls()
        return cls(Quarantine(path), Armoury(path.with_name(FILE)), path.with_name(CASES))

    @classmethod
    def of_a_trial(cls, path: Path) -> "Rulings":
        """Return the rulings of a throw-away core, not read yet: no rule refuses a case that is on trial."""
        return cls(Quarantine(path, parked_only=True), Armoury(path.with_name(FILE)))

    @property
    def rebuilding(self) -> Rebuilding:
        """The gate of every event that is rebuilt."""
        return Rebuilding(self.quarantine, self.armoury)

    @property
    def want_names(self) -> bool:
        """Whether it matters what a command is called."""
        return self.quarantine.rules.refuse or self.armoury.armed is not None

    def read(self) -> Unreadable | None:
        """Read everything anew. What can't be read of the rules leaves those before it in force. Blocks."""
        self.armoury.read()
        return self.quarantine.read()
