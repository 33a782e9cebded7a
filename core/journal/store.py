"""The store of a book, whichever it is: a file of SQLite's, or a database of a PostgreSQL server.

Whoever has a connection asks here, and is answered by the room of the store that it leads to (`stores`). What only
one of them has (a log to be emptied, a copy of a file) stands in that room alone.
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from types import ModuleType
from typing import Protocol

from sqlalchemy import Connection, Engine
from sqlalchemy.exc import DBAPIError

from core.journal.stores import postgresql, sqlite
from core.journal.stores.faults import EveryReaderTakenError, StoreError, StoreFault
from core.journal.stores.postgresql import PostgresWriting
from core.journal.stores.sqlite import (
    CHECKPOINT_PAGES,
    FREE_WITHIN_S,
    LEDGER_FILE,
    LOG_KEPT_BYTES,
    WritingEngine,
    close_writing,
    copy_beside_work,
    copy_whole,
    is_copy,
    open_writing,
    settle,
)
from core.journal.stores.whereabouts import Server, Whereabouts, server_at

__all__ = [
    "CHECKPOINT_PAGES",
    "FREE_WITHIN_S",
    "LEDGER_FILE",
    "LOG_KEPT_BYTES",
    "Server",
    "StoreError",
    "StoreFault",
    "Whereabouts",
    "Writing",
    "WritingEngine",
    "begin_fence",
    "begin_reading",
    "begin_writing",
    "beside",
    "close_writing",
    "commit",
    "copy_beside_work",
    "copy_whole",
    "end_holders",
    "has_ledger",
    "is_copy",
    "is_in_server",
    "is_interrupted",
    "is_open",
    "open_reading",
    "open_writing",
    "server_at",
    "settle",
    "size_bytes",
    "snapshot",
    "store_error",
    "tables_of",
    "take_seat",
    "wait_at_most",
    "watch",
    "writing",
]


class Writing(Protocol):
    """The engine of the one connection that writes, of either store."""

    def connect(self, busy_timeout_ms: int) -> Connection | StoreError:
        """Open that connection. `busy_timeout_ms`: how long the beginning of a transaction waits for a lock."""

    def tried(self) -> AbstractContextManager[Connection | None]:
        """Give a connection to an empty book that is gone afterwards; None: there is none to be had."""


def writing(where: Whereabouts) -> Writing:
    """Return what opens a book to be written; nothing is opened yet."""
    return PostgresWriting(where) if isinstance(where, Server) else WritingEngine(where)


def open_reading(
    where: Whereabouts,
    connections_max: int,
    busy_timeout_ms: int,
    *,
    alone: bool = False,
    first: Sequence[str] = (),
) -> Engine:
    """Return an engine whose connections can't write; nothing is opened yet. `alone`, `first`: see the file's own."""
    if isinstance(where, Server):
        return postgresql.open_reading(where, connections_max, busy_timeout_ms)
    return sqlite.open_reading(where, connections_max, busy_timeout_ms, alone=alone, first=first)


def is_in_server(of: Connection | Engine) -> bool:
    """Whether this leads to a database of a server."""
    return of.dialect.name == postgresql.DIALECT


def _room(of: Connection | Engine) -> ModuleType:
    return postgresql if is_in_server(of) else sqlite


def beside(readers: Engine) -> Engine:
    """Return an engine that reads the same book by a connection of its own each time, which is closed at the end.

    For components: what hangs there and is left behind keeps its connection, and none that a request waits for.
    """
    made: Engine = _room(readers).beside(readers)
    return made


def snapshot(engine: Engine, read_ms_max: int) -> AbstractContextManager[Connection]:
    """Give a connection that sees the book at one moment and is interrupted after `read_ms_max`.

    What takes too long is raised as a DBAPIError (`is_interrupted`). Where no connection becomes free in time, that is
    one too: `StoreFault.TAKEN`.
    """
    made: AbstractContextManager[Connection] = _room(engine).snapshot(engine, read_ms_max)
    return made


def begin_reading(connection: Connection) -> None:
    """Begin a transaction that sees the book at one moment."""
    _room(connection).begin_reading(connection)


def begin_writing(connection: Connection) -> None:
    """Begin a transaction that nobody else writes beside. Raises where the lock can't be had in time."""
    _room(connection).begin_writing(connection)


def begin_fence(connection: Connection) -> None:
    """Begin the transaction of a fence, also in a store in which there is nothing yet."""
    if is_in_server(connection):
        postgresql.begin_fence(connection)
    else:
        sqlite.begin_writing(connection)


def commit(connection: Connection) -> None:
    """Commit what is open. Where this raises, nobody knows what became of it."""
    if is_in_server(connection):
        postgresql.commit(connection)
    else:
        connection.exec_driver_sql("COMMIT").close()


def take_seat(connection: Connection, *, shared: bool) -> StoreError | None:
    """Keep others from the same book by accident; a file has a lock of its own beside it (`lock`)."""
    if not is_in_server(connection):
        return None
    try:
        postgresql.take_seat(connection, shared=shared)
    except DBAPIError as error:
        return store_error(error)
    return None


def end_holders(connection: Connection) -> bool:
    """Have those let go who hold the store's lock and are known to be gone; return whether anybody was made to.

    The kernel lets go of a file's lock with the process that held it; a server's session may outlive its core.
    """
    try:
        return is_in_server(connection) and postgresql.end_holders(connection) > 0
    except DBAPIError:
        return False


def wait_at_most(connection: Connection, busy_timeout_ms: int) -> None:
    """Have this connection wait so long for somebody else's lock from here on."""
    _room(connection).wait_at_most(connection, busy_timeout_ms)


def has_ledger(where: Whereabouts, busy_timeout_ms: int) -> bool:
    """Whether a ledger was begun there. Of a server that does not say it is taken for granted: whoever reads it hears why."""
    if not isinstance(where, Server):
        return where.is_file()
    readers = open_reading(where, 1, busy_timeout_ms)
    try:
        with readers.connect() as connection:
            return "meta" in tables_of(connection)
    except DBAPIError:
        return True
    finally:
        readers.dispose()


def tables_of(connection: Connection) -> set[str]:
    """Return the names of all tables there are."""
    names: set[str] = _room(connection).tables_of(connection)
    return names


def size_bytes(connection: Connection) -> int:
    """Return how large the ledger is, as this connection sees it."""
    found: int = _room(connection).size_bytes(connection)
    return found


def watch(connection: Connection, tick: Callable[[], object] | None) -> None:
    """Have `tick` called while a statement of this connection takes long, where its driver can; None: no longer."""
    if not is_in_server(connection):
        sqlite.watch(connection, tick)


def is_open(connection: Connection) -> bool:
    """Whether the connection is inside a transaction; a store ends one by itself after some errors."""
    found: bool = _room(connection).is_open(connection)
    return found


def is_interrupted(error: DBAPIError) -> bool:
    """Whether a read was ended because it took too long."""
    return sqlite.is_interrupted(error) or postgresql.is_interrupted(error.orig)


def store_error(error: DBAPIError) -> StoreError:
    """Return what a driver raised as a value."""
    if isinstance(error.orig, EveryReaderTakenError):
        return StoreError(StoreFault.TAKEN, "every connection that reads is taken")
    if postgresql.is_raised_by_it(error.orig):
        return postgresql.error_of(error.orig)
    return sqlite.error_of(error.orig)
