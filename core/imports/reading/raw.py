"""A table as a container holds it, before anybody knows which row is its header: rows of uneven length."""

from dataclasses import dataclass

from core.imports.reading.table import Row


@dataclass(frozen=True, slots=True)
class RawTable:
    """Rows in order, blank ones left out; `name` is the sheet, or the number of the HTML table, or None."""

    name: str | None
    rows: tuple[Row, ...]
