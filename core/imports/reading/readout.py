"""From the bytes of a file to one table: open it, take the table with the best header, name its columns.

Runs in the child. A workbook has several sheets and a page several tables, and the biggest is not always the
right one; the one whose header says most is. Columns in which nothing stands are left out, the others keep
the letter they had.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

import msgspec

from core.imports.reading.delimited import read_delimited
from core.imports.reading.formats import Format
from core.imports.reading.headers import Header, find_header
from core.imports.reading.hypertext import read_hypertext
from core.imports.reading.lettering import decode
from core.imports.reading.limits import ReadingLimits
from core.imports.reading.locked import open_ole
from core.imports.reading.names import unique_names
from core.imports.reading.ofx import encoding_said, read_ofx
from core.imports.reading.packing import Packing, Writing, packing_of, writing_of
from core.imports.reading.qif import read_qif
from core.imports.reading.raw import RawTable
from core.imports.reading.table import (
    CELL_CHARACTERS_MAX,
    COLUMNS_MAX,
    ROWS_MAX,
    Container,
    Note,
    Row,
    TableHead,
    Unreadable,
    Why,
)
from core.imports.reading.workbooks import read_workbook, weigh_zip

_EXPONENT: Final = re.compile(r"[0-9](?:\.[0-9]+)?[eE]\+[0-9]+")
_CELLS_MIN: Final = 2


class Readout(msgspec.Struct, frozen=True):
    """A table that was read, whole in memory."""

    head: TableHead
    lines: tuple[Row, ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """The unique names of the columns."""
        return self.head.columns

    def rows(self) -> Iterator[Row]:
        """The rows below the header."""
        return iter(self.lines)


class _Opened(msgspec.Struct, frozen=True):
    """What was in the file."""

    container: Container
    tables: Sequence[RawTable]
    encoding: str | None = None
    notes: tuple[Note, ...] = ()


def read(
    data: bytes,
    formats: Iterable[Format],
    limits: ReadingLimits,
    *,
    encoding: str | None = None,
    password: str | None = None,
) -> Readout | Unreadable:
    """The one table that matters in the bytes of a file, or why there is none."""
    if not data:
        return Unreadable(Why.EMPTY)
    if len(data) > limits.file_bytes_max:
        return Unreadable(Why.TOO_LARGE)
    known = tuple(formats)
    opened = _open(data, known, limits, encoding, password)
    if isinstance(opened, Unreadable):
        return opened
    judged = [(find_header(table.rows, known), table) for table in opened.tables if table.rows]
    if not judged:
        return Unreadable(Why.NO_TABLE)
    header, table = max(judged, key=lambda pair: pair[0].rank)
    return _finish(opened, header, table)


def _open(
    data: bytes,
    formats: tuple[Format, ...],
    limits: ReadingLimits,
    encoding: str | None,
    password: str | None,
) -> _Opened | Unreadable:
    match packing_of(data):
        case Packing.OTHER:
            return Unreadable(Why.UNSUPPORTED)
        case Packing.ZIP:
            return _open_workbook(data, limits)
        case Packing.OLE:
            opened = open_ole(data, password)
            return opened if isinstance(opened, Unreadable) else _open_workbook(opened, limits)
        case Packing.TEXT:
            return _open_text(data, formats, encoding)


def _open_workbook(data: bytes, limits: ReadingLimits) -> _Opened | Unreadable:
    zipped = packing_of(data) is Packing.ZIP
    refused = weigh_zip(data, limits.unpacked_bytes_max) if zipped else None
    tables = refused or read_workbook(data)
    if isinstance(tables, Unreadable):
        return tables
    return _Opened(Container.XLSX if zipped else Container.XLS, tables)


def _open_text(data: bytes, formats: tuple[Format, ...], encoding: str | None) -> _Opened | Unreadable:
    decoded = decode(data, encoding, encoding_said(data))
    if isinstance(decoded, Unreadable):
        return decoded
    notes = (Note.ENCODING_GUESSED,) if decoded.guessed else ()
    writing = writing_of(decoded.text)
    if writing is Writing.XML:
        return Unreadable(Why.UNSUPPORTED)
    container, tables = _tables_of(writing, decoded.text, formats)
    return tables if isinstance(tables, Unreadable) else _Opened(container, tables, decoded.encoding, notes)


def _tables_of(
    writing: Writing, text: str, formats: tuple[Format, ...]
) -> tuple[Container, Sequence[RawTable] | Unreadable]:
    match writing:
        case Writing.HTML:
            return Container.HTML, read_hypertext(text)
        case Writing.OFX:
            container, table = Container.OFX, read_ofx(text)
        case Writing.QIF:
            container, table = Container.QIF, read_qif(text)
        case _:
            container, table = Container.CSV, read_delimited(text, formats)
    return container, table if isinstance(table, Unreadable) else [table]


def _finish(opened: _Opened, header: Header, table: RawTable) -> Readout | Unreadable:
    found = header.index >= 0
    top = table.rows[header.index] if found else None
    below = table.rows[header.index + 1 :]
    width = max((_width(row) for row in (*below, *([top] if top else []))), default=0)
    if len(below) > ROWS_MAX:
        return Unreadable(Why.TOO_MANY_ROWS)
    if width > COLUMNS_MAX:
        return Unreadable(Why.TOO_MANY_COLUMNS)
    if width < _CELLS_MIN:
        return Unreadable(Why.NO_TABLE)
    names = unique_names(_padded(top.cells if top else (), width))
    kept = _columns_with_something(top, below, width)
    lines = tuple(_cut(row, kept) for row in below)
    notes = (*opened.notes, *([] if found else [Note.NO_HEADER]), *_notes(below))
    head = TableHead(
        container=opened.container,
        encoding=opened.encoding,
        sheet=table.name,
        header_line=top.line if top else None,
        columns=tuple(names[index] for index in kept),
        row_count=len(lines),
        notes=notes,
    )
    return Readout(head, lines)


def _width(row: Row) -> int:
    """Cells up to the last one in which something stands: some banks end every line with a delimiter."""
    return max((index + 1 for index, cell in enumerate(row.cells) if cell.strip()), default=0)


def _padded(cells: tuple[str, ...], width: int) -> tuple[str, ...]:
    return (*cells[:width], *([""] * (width - len(cells))))


def _columns_with_something(top: Row | None, below: Sequence[Row], width: int) -> tuple[int, ...]:
    empty = set(range(width))
    for row in (*([top] if top else []), *below):
        empty = {index for index in empty if index >= len(row.cells) or not row.cells[index].strip()}
    return tuple(index for index in range(width) if index not in empty)


def _cut(row: Row, kept: tuple[int, ...]) -> Row:
    size = len(row.cells)
    return Row(
        row.line, tuple(row.cells[index][:CELL_CHARACTERS_MAX] if index < size else "" for index in kept)
    )


def _notes(rows: Sequence[Row]) -> list[Note]:
    exponent = any(_EXPONENT.fullmatch(cell) for row in rows for cell in row.cells if "+" in cell)
    cut = any(len(cell) > CELL_CHARACTERS_MAX for row in rows for cell in row.cells)
    return [note for note, holds in ((Note.EXPONENT, exponent), (Note.CELL_CUT, cut)) if holds]
