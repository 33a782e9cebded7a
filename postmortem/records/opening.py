"""Opens `hardcore.db`: one file, one process, in write-ahead mode.

What can't be opened is the value `RecordsFailed` with the next step. A file that is damaged is put aside under a name
that says when, and a new one is begun: incidents are read again from their folders, and what the guard refuses it goes
on refusing without us. What is lost then is what people wrote here, and that is said.
"""

import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import msgspec
from sqlalchemy import Connection, Engine, create_engine
from sqlalchemy.exc import DatabaseError, OperationalError
from sqlalchemy.pool import QueuePool

from postmortem import placing
from postmortem.records.tables import SCHEMA, migrate

#: How long a statement waits for another of our own threads.
BUSY_MS: Final = 5_000
#: Connections of our own threads.
CONNECTIONS_MAX: Final = 8
#: The log's size after a checkpoint.
LOG_KEPT_BYTES: Final = 4 << 20


class RecordsFailed(msgspec.Struct, frozen=True):
    """The archive can't be opened; `reason` is one sentence for people."""

    reason: str


class Records(msgspec.Struct, frozen=True):
    """The open archive. `put_aside`: the damaged file that was found in its place, if one was."""

    engine: Engine
    put_aside: Path | None = None
    _writing: threading.Lock = msgspec.field(default_factory=threading.Lock)

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """Give a connection that sees the archive at one moment."""
        with self.engine.connect() as connection:
            connection.exec_driver_sql("BEGIN")
            try:
                yield connection
            finally:
                connection.exec_driver_sql("ROLLBACK")

    @contextmanager
    def writing(self) -> Iterator[Connection]:
        """Give a connection inside a transaction, which is committed unless something is raised."""
        with self._writing, self.engine.connect() as connection:
            connection.exec_driver_sql("BEGIN IMMEDIATE")
            try:
                yield connection
            except BaseException:
                connection.exec_driver_sql("ROLLBACK")
                raise
            connection.exec_driver_sql("COMMIT")

    def close(self) -> None:
        """Let go of the file."""
        self.engine.dispose()


def open_records(path: Path) -> Records | RecordsFailed:
    """Open the archive, made new or brought forward where it has to be."""
    opened = _open(path)
    if opened is not None:
        return opened
    try:
        aside = _put_aside(path)
    except OSError as error:
        return RecordsFailed(placing.why(error, "the damaged archive could not be put aside"))
    again = _open(path)
    if isinstance(again, Records):
        return Records(again.engine, aside)
    return again or RecordsFailed(f"no archive can be made at {path.name}")


def _open(path: Path) -> Records | RecordsFailed | None:
    """Return the archive, why there is none, or None where the file is damaged."""
    try:
        path.touch(mode=0o600)
    except OSError as error:
        return RecordsFailed(placing.why(error, "the archive could not be opened"))
    engine = create_engine(
        "sqlite://",
        creator=lambda: _connect(path),
        poolclass=QueuePool,
        pool_size=CONNECTIONS_MAX,
        max_overflow=0,
        isolation_level="AUTOCOMMIT",
    )
    records = Records(engine)
    try:
        with records.writing() as connection:
            version = connection.exec_driver_sql("PRAGMA user_version").scalar_one()
            if version < SCHEMA:
                migrate(connection, version)
    except OperationalError as error:
        engine.dispose()
        return RecordsFailed(f"the archive could not be opened: {error.orig}")
    except DatabaseError:
        engine.dispose()
        return None
    if version > SCHEMA:
        engine.dispose()
        return RecordsFailed(f"the archive was written by a newer version ({version}, known here: {SCHEMA})")
    return records


def _connect(path: Path) -> sqlite3.Connection:
    connection = sqlite3.connect(path, timeout=BUSY_MS / 1000, isolation_level=None, check_same_thread=False)
    for pragma in (
        "journal_mode = WAL",
        "synchronous = FULL",  # a letter's file is removed once its row is committed
        "foreign_keys = ON",
        "trusted_schema = OFF",
        f"journal_size_limit = {LOG_KEPT_BYTES}",
    ):
        connection.execute(f"PRAGMA {pragma}").close()
    return connection


def _put_aside(path: Path) -> Path:
    """Give a damaged archive another name, its log with it; raises OSError."""
    aside = path.with_name(f"{path.name}.damaged-{placing.now().replace(':', '')}")
    for suffix in ("", "-wal", "-shm"):
        found = path.with_name(path.name + suffix)
        if found.exists():
            found.rename(aside.with_name(aside.name + suffix))
    return aside
