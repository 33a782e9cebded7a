"""What is kept of an import beside its file: the wish, what a look at its rows found, and how far it is.

Three records, because they change at different paces. The manifest is the wish and is flushed to the disk
before anybody is told of it; the survey is a reading and can be made anew; the progress may be older than the
ledger after a power cut, because each row's key in the ledger says what became of it. Password: nowhere.
"""

from typing import Final

import msgspec

from core.imports.reading.balance import BalanceVerdict
from core.imports.reading.formats import Format
from core.imports.reading.mapping import Mapping
from core.imports.reading.own_formats import Broken
from core.imports.states import State

SAMPLE_MAX: Final = 20
PROBLEMS_MAX: Final = 200
CELLS_SHOWN_MAX: Final = 12
CELL_SHOWN_CHARACTERS_MAX: Final = 80


class Manifest(msgspec.Struct, frozen=True):
    """The wish. `name` is what the client called the file, a text and never a path."""

    id: str
    state: State
    name: str
    file_bytes: int
    sha256: str
    made_ns: int
    encoding: str | None = None  # asked for; None: found in the file
    format: str | None = None
    account: str | None = None
    currency: str | None = None  # the account's
    mapping: Mapping = Mapping()
    chosen: tuple[str, ...] = ()  # fields of the mapping that a person set and no guess may change
    skip_duplicates: bool = True
    fault: str | None = None  # why it failed
    own_formats: tuple[Format, ...] = ()  # of the household, as they were when the file was looked at


class Problem(msgspec.Struct, frozen=True):
    """A row that is not booked, and why. `cells` as `shown`; `values` are named by the reason's sentence."""

    line: int
    reason: str
    cells: tuple[str, ...]
    values: dict[str, str] = {}


class EntryShown(msgspec.Struct, frozen=True, omit_defaults=False):
    """What a row becomes, for the eye."""

    date: str
    amount: str
    currency: str
    description: str
    category: str | None
    payment_method: str | None


class SampleRow(msgspec.Struct, frozen=True):
    """One of the first rows, whatever became of it."""

    line: int
    cells: tuple[str, ...]
    entry: EntryShown | None
    reason: str | None
    values: dict[str, str] = {}  # as in Problem


class Survey(msgspec.Struct, frozen=True):
    """What a look at all rows found. `duplicates` are good rows that the ledger has already."""

    total: int
    good: int = 0
    refused: int = 0
    skipped: int = 0
    duplicates: int = 0
    sample: tuple[SampleRow, ...] = ()
    problems: tuple[Problem, ...] = ()
    balance_check: BalanceVerdict = BalanceVerdict.ABSENT
    fitting: tuple[str, ...] = ()  # ids of the formats whose header the file has, the best first
    broken_formats: tuple[Broken, ...] = ()  # files beside the household's own layouts that are none


class Progress(msgspec.Struct, frozen=True):
    """How far the booking is. The first `done` rows of the file are settled, and no other."""

    done: int = 0
    booked: int = 0
    duplicates: int = 0
    refused: int = 0
    skipped: int = 0
    problems: tuple[Problem, ...] = ()


def shown(cells: tuple[str, ...]) -> tuple[str, ...]:
    """Return of a row's cells what an eye takes in: a wide file has millions of characters in its first rows."""
    rest = ("…",) if len(cells) > CELLS_SHOWN_MAX else ()
    return (*map(_cut, cells[:CELLS_SHOWN_MAX]), *rest)


def _cut(cell: str) -> str:
    return cell if len(cell) <= CELL_SHOWN_CHARACTERS_MAX else cell[: CELL_SHOWN_CHARACTERS_MAX - 1] + "…"
