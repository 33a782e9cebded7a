"""Rulings: what the guard has said of this ledger's commands and events, and what it has armed for a drill.

One value that is made once and handed to whoever has to go by it: the writer, the proofs, the importer, the service. A core
that nobody guards has one too, and it is empty. Not chosen: a look at the files wherever they matter; two parts of one
core could then go by two of them.
"""

import time
from pathlib import Path
from typing import Final

import msgspec

from core.guarded.poison import FILE, Armoury
from core.guarded.quarantine import Quarantine, Unreadable
from core.journal.rebuilding import Rebuilding

RULES: Final = "state/quarantine.json"  # in a data folder: where its guard writes them
WORD_EVERY_S: Final = 0.02  # between two looks whether the guard's word has come
CASES: Final = "cases"  # beside the rules: where a suspect's case is filed


class Word:
    """Whether the guard of this life has said whom it suspects of the death before.

    It reads who was at work in the dead core while the next one already opens its book, and says it when it lets people in.
    What the core begins by itself (imports, the scheduler's errands) waits for that word: it would be the first to run again
    what the one before died of. Who has no guard waits for nobody, and a guard that died as well is not waited for long.
    """

    def __init__(self) -> None:
        """Nothing is waited for yet."""
        self._due_ns: int | None = None

    def expect(self, within_ms: int) -> None:
        """Wait for it from now on, for so long."""
        self._due_ns = time.monotonic_ns() + within_ms * 1_000_000

    def heard(self) -> None:
        """The rules were read at the guard's word."""
        self._due_ns = None

    @property
    def is_said(self) -> bool:
        """Whether nothing more is to be waited for."""
        return self._due_ns is None or time.monotonic_ns() >= self._due_ns


class Rulings(msgspec.Struct, frozen=True):
    """The rules in force and what is armed. `cases`: where cases are filed; None: nobody would read one."""

    quarantine: Quarantine = msgspec.field(default_factory=Quarantine)
    armoury: Armoury = msgspec.field(default_factory=Armoury)
    cases: Path | None = None
    word: Word = msgspec.field(default_factory=Word)

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
