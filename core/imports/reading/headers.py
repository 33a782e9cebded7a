"""Finds the header of a table: by names that formats know, by words that usually head a column, by shape.

Banks put anything from nothing to seventeen lines above it, so its position proves nothing. A row in which a
format finds all its names wins, and of two formats the one that asked for more names; then the row with the
most words that usually head columns; then a row of plain words that stands right above a row with a date.
The same score chooses among delimiters, sheets and HTML tables: the right one is the one whose header is best.
"""

import re
from collections.abc import Iterable, Sequence
from typing import Final

import msgspec

from core.imports.reading.dates import looks_like_date
from core.imports.reading.formats import SCAN_ROWS_MAX, Format
from core.imports.reading.names import canonical
from core.imports.reading.roles import roles_in
from core.imports.reading.table import Row

_CELLS_MIN: Final = 2
_HAS_DIGIT: Final = re.compile(r"[0-9]")


class Header(msgspec.Struct, frozen=True):
    """A header that was found. `index` is its place among the rows, -1 when there is none.

    `required` counts the names a format asked for and found, `roles` the words that usually head a column,
    `cells` the widest row: the more of them, in this order, the better the table.
    """

    required: int
    roles: int
    shape: bool
    cells: int
    index: int = -1

    @property
    def rank(self) -> tuple[int, int, bool, int]:
        """What headers of different tables are compared by."""
        return (self.required, self.roles, self.shape, self.cells)


def find_header(rows: Sequence[Row], formats: Iterable[Format]) -> Header:
    """The best header among the first rows; its index is -1 when the table has none."""
    known = tuple(formats)
    top = rows[:SCAN_ROWS_MAX]
    best = Header(0, 0, shape=False, cells=max((_filled(row) for row in top), default=0))
    for index, row in enumerate(top):
        found = _judge(row, index, top, known)
        # Of two equals the upper one is the header; the lower one is its repetition.
        if found is not None and found.rank[:3] > best.rank[:3]:
            best = found
    return best


def _judge(row: Row, index: int, top: Sequence[Row], formats: tuple[Format, ...]) -> Header | None:
    if _filled(row) < _CELLS_MIN:
        return None
    names = frozenset(canonical(cell) for cell in row.cells if cell)
    required = max(
        (len(form.header.required) for form in formats if index < form.header.scan_rows and form.fits(names)),
        default=0,
    )
    roles = roles_in(row.cells)
    heads = "date" in roles and bool(roles.keys() & {"amount", "in", "out"})
    shape = _is_words(row) and index + 1 < len(top) and _has_date(top[index + 1])
    if not (required or heads or shape):
        return None
    return Header(required, len(roles) if heads else 0, shape=shape, cells=_filled(row), index=index)


def _filled(row: Row) -> int:
    return sum(1 for cell in row.cells if cell.strip())


def _is_words(row: Row) -> bool:
    return not any(_HAS_DIGIT.search(cell) for cell in row.cells)


def _has_date(row: Row) -> bool:
    return any(looks_like_date(cell) for cell in row.cells)
