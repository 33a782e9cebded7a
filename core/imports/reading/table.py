"""The words of reading: a table of text cells, what is known about it, and why a file gave none.

Every cell is text. A spreadsheet's dates and numbers become text before anything looks at them, so that a
table is the same whether it came as CSV, as HTML or as a workbook, and no later step can round a number that
it never saw as one. Cells with types were not chosen: five containers would then mean five kinds of row.
"""

from collections.abc import Iterator
from enum import StrEnum
from typing import Final, Protocol

import msgspec

ROWS_MAX: Final = 200_000
COLUMNS_MAX: Final = 100
CELL_CHARACTERS_MAX: Final = 4_000


class Container(StrEnum):
    """How the rows were packed, as the bytes say and not the name."""

    CSV = "csv"
    HTML = "html"
    XLSX = "xlsx"
    XLS = "xls"
    OFX = "ofx"
    QIF = "qif"


class Why(StrEnum):
    """Why a file gave no table. Each has its sentence in the catalogue."""

    EMPTY = "empty"
    BINARY = "binary"
    UNSUPPORTED = "unsupported"
    TOO_LARGE = "too-large"
    WRONG_ENCODING = "wrong-encoding"
    UNKNOWN_ENCODING = "unknown-encoding"
    NO_TABLE = "no-table"
    LOCKED = "locked"
    WRONG_PASSWORD = "wrong-password"  # noqa: S105 - the name of a reason, not a password
    ZIP_BOMB = "zip-bomb"
    TOO_MANY_ROWS = "too-many-rows"
    TOO_MANY_COLUMNS = "too-many-columns"
    CELL_TOO_LONG = "cell-too-long"
    UNREADABLE = "unreadable"
    TOO_SLOW = "too-slow"
    OUT_OF_MEMORY = "out-of-memory"


class Note(StrEnum):
    """What a person should know of a table although it could be read."""

    ENCODING_GUESSED = "encoding-guessed"
    NO_HEADER = "no-header"
    EXPONENT = "exponent"
    CELL_CUT = "cell-cut"


class Row(msgspec.Struct, frozen=True, array_like=True):
    """One row: the line (or spreadsheet row, from 1) where it begins, and its cells, one for each column."""

    line: int
    cells: tuple[str, ...]


class TableHead(msgspec.Struct, frozen=True):
    """What is known about a table besides its rows. Plain JSON on both sides of the child's pipe.

    `header_line` is null for a table without a header; `sheet` is the sheet's name or the number of the HTML
    table, null where there is only one. `columns` are unique names: a twin gets `#2`, an empty one its letter
    in brackets. Columns in which nothing stands are left out.
    """

    container: Container
    encoding: str | None
    sheet: str | None
    header_line: int | None
    columns: tuple[str, ...]
    row_count: int
    notes: tuple[Note, ...] = ()


class Unreadable(msgspec.Struct, frozen=True):
    """Why there is no table; `line` is where the trouble was seen, when that is known."""

    reason: Why
    line: int | None = None


class Table(Protocol):
    """A table whose rows can be read again and again, in order."""

    @property
    def columns(self) -> tuple[str, ...]:
        """The unique names of the columns."""

    def rows(self) -> Iterator[Row]:
        """The rows below the header, one after the other."""
