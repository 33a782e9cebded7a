"""A table on disk: one line of JSON that says what it is, then one line for each row.

The child writes it once; the ledger reads it as often as it likes, a row at a time, also after a death and
also when the file itself was locked and its password is long forgotten. A database was not chosen: the rows
are read from beginning to end and never looked up.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import msgspec

from core.imports.reading.table import Row, TableHead, Unreadable, Why

_HEAD: Final = msgspec.json.Decoder(TableHead)
_ROW: Final = msgspec.json.Decoder(Row)
_JSON: Final = msgspec.json.Encoder()


class ReadTable(msgspec.Struct, frozen=True):
    """A table that was read: what is known of it, and the file its rows are in."""

    head: TableHead
    path: Path

    @property
    def columns(self) -> tuple[str, ...]:
        """The unique names of the columns."""
        return self.head.columns

    def rows(self) -> Iterator[Row]:
        """The rows below the header, read from disk one by one. OSError if the file is gone."""
        with self.path.open("rb") as file:
            file.readline()
            yield from map(_ROW.decode, file)


def open_table(path: Path) -> ReadTable | Unreadable:
    """The table written to `path` earlier, or `unreadable` if none is there."""
    try:
        with path.open("rb") as file:
            return ReadTable(_HEAD.decode(file.readline()), path)
    except (OSError, msgspec.MsgspecError):
        return Unreadable(Why.UNREADABLE)


def write_table(path: Path, head: TableHead, rows: Iterable[Row], bytes_max: int) -> Unreadable | None:
    """Write a table; `too-large`, and no whole table at `path`, if it takes more than `bytes_max`."""
    written = 0
    with path.open("wb") as file:
        for part in (head, *rows):
            line = _JSON.encode(part) + b"\n"
            written += len(line)
            if written > bytes_max:
                return Unreadable(Why.TOO_LARGE)
            file.write(line)
    return None
