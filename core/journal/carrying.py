"""Carrying a ledger out of a server into a file: the same tables, as they stood at one moment.

What comes of it is a ledger like any other: a trial works on it, a proof proves it, and it can be kept and opened without
a server. Everything is read in one snapshot, a slice at a time, and the rules of the tables are laid once all rows
are there, because what was written in an older epoch would be refused by them. Not chosen: a copy inside the server, which
would need rights that a ledger's own user has no other use for.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Final

from sqlalchemy import Connection, insert, select
from sqlalchemy.exc import DBAPIError

from core.journal import schema
from core.journal.store import (
    Server,
    StoreError,
    Whereabouts,
    WritingEngine,
    begin_writing,
    close_writing,
    commit,
    copy_beside_work,
    open_reading,
    settle,
    snapshot,
    store_error,
)

SLICE_ROWS: Final = 2_000
READ_MS_MAX: Final = 10_000
BUSY_MS: Final = 2_000


def copy_now(where: Whereabouts, into: Path, tick: Callable[[], object]) -> StoreError | None:
    """Copy a ledger that others write to, as it stands at one moment, into a new file; return what failed.

    `tick` is called again and again meanwhile, and may raise.
    """
    return carry(where, into, tick) if isinstance(where, Server) else copy_beside_work(where, into, tick)


def carry(server: Server, into: Path, tick: Callable[[], object]) -> StoreError | None:
    """Copy a ledger out of a server into a new file; see `copy_now`."""
    copy = WritingEngine(into, lasting=False).connect(BUSY_MS)
    if isinstance(copy, StoreError):
        return copy
    readers = open_reading(server, 1, BUSY_MS)
    try:
        with snapshot(readers, READ_MS_MAX) as source:
            begin_writing(copy)
            schema.metadata.create_all(copy, checkfirst=False)
            _pour(source, copy, tick)
            schema.lay_triggers(copy)
            commit(copy)
    except DBAPIError as error:
        return store_error(error)
    finally:
        readers.dispose()
        close_writing(copy)
    return settle(into)


def _pour(source: Connection, copy: Connection, tick: Callable[[], object]) -> None:
    for table in schema.metadata.sorted_tables:
        with source.execute(select(table), execution_options={"yield_per": SLICE_ROWS}) as rows:
            for part in rows.mappings().partitions():
                copy.execute(insert(table), [dict(row) for row in part])
                tick()
