"""Reads delimited text: the delimiter is the one that gives the best header, records keep their line numbers.

Line ends come as CR LF, LF, CR alone and CR CR LF, and all become LF first; a line break inside quotes stays a
part of its cell. A cell that never ends is a quotation mark that was never closed and would swallow the rest
of the file without a word: that is refused with its line. The csv module's own sniffer was not chosen, it
looks at letters and not at what a header says.
"""

import csv
import io
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Final

from core.imports.reading.formats import SCAN_ROWS_MAX, Format
from core.imports.reading.headers import find_header
from core.imports.reading.raw import RawTable
from core.imports.reading.table import CELL_CHARACTERS_MAX, COLUMNS_MAX, ROWS_MAX, Row, Unreadable, Why

CELLS_MAX: Final = 100 * COLUMNS_MAX  # of one record: no row of delimiters is longer
DELIMITERS: Final = (",", ";", "\t", "|")


def read_delimited(text: str, formats: Iterable[Format]) -> RawTable | Unreadable:
    """The records of `text`, cut by the delimiter that suits it."""
    lines = text.replace("\r\r\n", "\n").replace("\r\n", "\n").replace("\r", "\n")
    known = tuple(formats)
    delimiter = max(DELIMITERS, key=lambda mark: find_header(_sample(lines, mark), known).rank)
    rows: list[Row] = []
    for row in _records(lines, delimiter):
        if isinstance(row, Unreadable):
            return row
        rows.append(row)
        if len(rows) > ROWS_MAX + SCAN_ROWS_MAX:
            return Unreadable(Why.TOO_MANY_ROWS)
    return RawTable(None, tuple(rows))


def _sample(lines: str, delimiter: str) -> list[Row]:
    return [row for row in islice(_records(lines, delimiter), SCAN_ROWS_MAX) if isinstance(row, Row)]


def _records(lines: str, delimiter: str) -> Iterator[Row | Unreadable]:
    """The records that aren't blank, each with the line it begins on; at the first fault, why, and the end."""
    csv.field_size_limit(CELL_CHARACTERS_MAX)
    reader = csv.reader(io.StringIO(lines, newline="\n"), delimiter=delimiter)
    begun = 1
    try:
        for cells in reader:
            if len(cells) > CELLS_MAX:
                yield Unreadable(Why.TOO_MANY_COLUMNS, begun)
                return
            if any(cell.strip() for cell in cells):
                yield Row(begun, tuple(cells))
            begun = reader.line_num + 1
    except csv.Error:
        yield Unreadable(Why.CELL_TOO_LONG, begun)
