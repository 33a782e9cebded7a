"""Opening the store: one connection that writes, a few that can't, and SQLite's errors as values.

SQLite's stdlib driver is the only SQLite in this process. Transactions are begun and ended by the words they
have in SQL: `BEGIN IMMEDIATE` is where waiting for the lock happens and must be told apart from what happens
inside, so neither the driver nor SQLAlchemy may begin one on its own. Commits go to the disk (`FULL`): it
costs 17 % under load and saves the last second of a power cut. The write-ahead log keeps its room after a
checkpoint, because a log that has wrapped once needs no new space when the disk is full at the next fence.
"""

import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Final

from sqlalchemy import Connection, Engine, create_engine
from sqlalchemy.exc import DBAPIError
from sqlalchemy.pool import QueuePool, StaticPool

LEDGER_FILE: Final = "ledger.db"
CHECKPOINT_PAGES: Final = 1_000  # of 4 KiB, SQLite's default
LOG_KEPT_BYTES: Final = 8 * 1024 * 1024  # more than a checkpoint's worth, so a wrapped log keeps its room
_PROGRESS_STEPS: Final = 10_000  # virtual machine steps between two looks at the clock, well under 1 ms
_IOERR_SHMSIZE: Final = 4874  # the shared index could not grow: what a full disk looks like at the first open


class StoreFault(Enum):
    """What kind of no the store gave."""

    BUSY = "busy"
    NO_ROOM = "no room"
    READ_ONLY = "read only"
    DAMAGED = "damaged"
    OTHER = "other"


@dataclass(frozen=True, slots=True)
class StoreError:
    """An error of the store: its kind and its own words."""

    fault: StoreFault
    text: str


def store_error(error: DBAPIError) -> StoreError:
    """Return what the driver raised as a value."""
    code = getattr(error.orig, "sqlite_errorcode", sqlite3.SQLITE_ERROR)
    name = getattr(error.orig, "sqlite_errorname", type(error.orig).__name__)
    match code & 0xFF:
        case sqlite3.SQLITE_BUSY | sqlite3.SQLITE_LOCKED:
            fault = StoreFault.BUSY
        case sqlite3.SQLITE_FULL:
            fault = StoreFault.NO_ROOM
        case sqlite3.SQLITE_READONLY:
            fault = StoreFault.READ_ONLY
        case sqlite3.SQLITE_CORRUPT | sqlite3.SQLITE_NOTADB:
            fault = StoreFault.DAMAGED
        case _:
            fault = StoreFault.NO_ROOM if code == _IOERR_SHMSIZE else StoreFault.OTHER
    return StoreError(fault, f"{name}: {error.orig}")


def open_writing(path: Path, busy_timeout_ms: int) -> Connection | StoreError:
    """Open the one connection that writes, making the file if there is none.

    `busy_timeout_ms`: how long BEGIN IMMEDIATE waits for somebody else's lock.
    """

    def connect() -> sqlite3.Connection:
        return sqlite3.connect(
            path, timeout=busy_timeout_ms / 1000, isolation_level=None, check_same_thread=False
        )

    engine = create_engine("sqlite://", creator=connect, poolclass=StaticPool, isolation_level="AUTOCOMMIT")
    try:
        connection = engine.connect()
        for pragma in (
            "journal_mode = WAL",
            "synchronous = FULL",
            "foreign_keys = ON",
            "trusted_schema = OFF",
            f"wal_autocheckpoint = {CHECKPOINT_PAGES}",
            f"journal_size_limit = {LOG_KEPT_BYTES}",
        ):
            connection.exec_driver_sql(f"PRAGMA {pragma}").close()
    except DBAPIError as error:
        return store_error(error)
    return connection


def open_reading(path: Path, connections_max: int, busy_timeout_ms: int, *, alone: bool = False) -> Engine:
    """Return an engine whose connections can't write and never checkpoint; nothing is opened yet.

    `alone`: nobody writes to the file while this engine lives, and all of it is in the file. It is then read
    without the log's shared index, which a disk that takes no write can't hold.
    """
    uri = f"{path.absolute().as_uri()}?mode=ro{'&immutable=1' if alone else ''}"

    def connect() -> sqlite3.Connection:
        connection = sqlite3.connect(
            uri, uri=True, timeout=busy_timeout_ms / 1000, isolation_level=None, check_same_thread=False
        )
        connection.execute("PRAGMA query_only = ON").close()
        connection.execute("PRAGMA wal_autocheckpoint = 0").close()
        return connection

    return create_engine(
        "sqlite://",
        creator=connect,
        poolclass=QueuePool,
        pool_size=connections_max,
        max_overflow=0,
        isolation_level="AUTOCOMMIT",
    )


@contextmanager
def snapshot(engine: Engine, read_ms_max: int) -> Iterator[Connection]:
    """Give a connection that sees the book at one moment and is interrupted after `read_ms_max`.

    An open read transaction keeps the log from being checkpointed (one grew it to 244 MB in 6 s), so a
    statement that takes too long ends with SQLITE_INTERRUPT, raised as SQLAlchemy's OperationalError.
    """
    with engine.connect() as connection:
        driver = connection.connection.driver_connection
        assert isinstance(driver, sqlite3.Connection)
        deadline_ns = time.monotonic_ns() + read_ms_max * 1_000_000
        driver.set_progress_handler(lambda: int(time.monotonic_ns() > deadline_ns), _PROGRESS_STEPS)
        connection.exec_driver_sql("BEGIN").close()
        try:
            yield connection
        finally:
            driver.set_progress_handler(None, 0)
            connection.exec_driver_sql("ROLLBACK").close()


def is_interrupted(error: DBAPIError) -> bool:
    """Whether a read was ended because it took too long."""
    return getattr(error.orig, "sqlite_errorcode", 0) == sqlite3.SQLITE_INTERRUPT


def is_open(connection: Connection) -> bool:
    """Whether the connection is inside a transaction; SQLite ends one by itself after some errors."""
    driver = connection.connection.driver_connection
    assert isinstance(driver, sqlite3.Connection)
    return driver.in_transaction
