"""Reads workbooks: what a zip declares is weighed before it is opened, every cell becomes text.

A workbook of a few kilobytes can unpack to gigabytes. The declared sizes are judged first, which stops the
honest bombs; the ones that lie meet the limits of this process. Numbers lose the `.0` that no bank wrote,
dates become ISO, and a number too long for a spreadsheet shows itself in exponent notation and is not made
whole again, because its digits are gone.
"""

import datetime as dt
import io
import zipfile
from collections.abc import Iterator
from typing import Final

import python_calamine as calamine

from core.imports.reading.formats import SCAN_ROWS_MAX
from core.imports.reading.raw import RawTable
from core.imports.reading.table import COLUMNS_MAX, ROWS_MAX, Row, Unreadable, Why

ENTRIES_MAX: Final = 2_000
SHEETS_MAX: Final = 50
# XML of a bank's rows packs 5 to 40 times; a bomb a thousand times. Small files may pack as they like.
RATIO_MAX: Final = 250
RATIO_FREE_BYTES: Final = 8 << 20
_WORKBOOK: Final = "xl/workbook.xml"

_Cell = int | float | str | bool | dt.time | dt.date | dt.datetime | dt.timedelta


def weigh_zip(data: bytes, unpacked_bytes_max: int) -> Unreadable | None:
    """Why this zip isn't opened: no workbook, a bomb by its own declaration, or no zip at all."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = archive.infolist()
    except (zipfile.BadZipFile, ValueError, EOFError, NotImplementedError):
        return Unreadable(Why.UNREADABLE)
    unpacked = sum(entry.file_size for entry in entries)
    packed = max(1, sum(entry.compress_size for entry in entries))
    swells = unpacked > RATIO_FREE_BYTES and unpacked / packed > RATIO_MAX
    if len(entries) > ENTRIES_MAX or unpacked > unpacked_bytes_max or swells:
        return Unreadable(Why.ZIP_BOMB)
    if _WORKBOOK not in {entry.filename for entry in entries}:
        return Unreadable(Why.UNSUPPORTED)
    return None


def read_workbook(data: bytes) -> list[RawTable] | Unreadable:
    """The visible sheets that hold anything, in order. Old and new workbooks alike."""
    try:
        with calamine.load_workbook(io.BytesIO(data)) as book:
            return _sheets(book)
    except calamine.PasswordError:
        return Unreadable(Why.LOCKED)
    except (calamine.CalamineError, OSError, ValueError):
        return Unreadable(Why.UNREADABLE)


def _sheets(book: calamine.CalamineWorkbook) -> list[RawTable] | Unreadable:
    shown = [
        sheet.name
        for sheet in book.sheets_metadata
        if sheet.typ is calamine.SheetTypeEnum.WorkSheet
        and sheet.visible is calamine.SheetVisibleEnum.Visible
    ]
    tables: list[RawTable] = []
    for name in shown[:SHEETS_MAX]:
        sheet = book.get_sheet_by_name(name)
        if sheet.start is None:
            continue
        if sheet.height > ROWS_MAX + SCAN_ROWS_MAX:
            return Unreadable(Why.TOO_MANY_ROWS)
        if sheet.width > COLUMNS_MAX:
            return Unreadable(Why.TOO_MANY_COLUMNS)
        tables.append(RawTable(name if len(shown) > 1 else None, tuple(_rows(sheet, sheet.start[1]))))
    return tables


def _rows(sheet: calamine.CalamineSheet, blank_columns: int) -> Iterator[Row]:
    # The reader leaves out empty columns on the left, which would rename all others: [A] is column A.
    margin = ("",) * min(blank_columns, COLUMNS_MAX)
    for number, values in enumerate(sheet.iter_rows(), 1):
        cells = (*margin, *map(text_of, values))
        if any(cell.strip() for cell in cells):
            yield Row(number, cells)


def text_of(value: _Cell) -> str:
    """A cell as text: whole numbers without `.0`, dates as ISO, times to the second."""
    match value:
        case str():
            return value
        case bool():
            return str(value).upper()
        case int() | float():
            return format(value, ".15g")
        case dt.datetime():
            # A spreadsheet counts days as a fraction: 11:40:59 comes back as 11:40:58.999997.
            return (value + dt.timedelta(microseconds=500_000)).replace(microsecond=0).isoformat(" ")
        case dt.date():
            return value.isoformat()
        case dt.time():
            return value.isoformat("seconds")
        case dt.timedelta():
            return str(dt.timedelta(seconds=round(value.total_seconds())))
