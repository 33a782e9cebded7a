"""A table as a container holds it, before anybody knows which row is its header: rows of uneven length."""

import msgspec

from core.imports.reading.table import Row


class RawTable(msgspec.Struct, frozen=True):
    """Rows in order, blank ones left out; `name` is the sheet, or the number of the HTML table, or None."""

    name: str | None
    rows: tuple[Row, ...]
