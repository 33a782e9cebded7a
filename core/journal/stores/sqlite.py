"""The store in a file: SQLite, with one connection that writes, a few that can't, and its errors as values.

SQLite's stdlib driver is the only SQLite in this process. Transactions are begun and ended by the words they
have in SQL: `BEGIN IMMEDIATE` is where waiting for the lock happens and must be told apart from what happens
inside, so neither the driver nor SQLAlchemy may begin one on its own. Commits go to the disk (`FULL`): it
costs 17 % under load and saves the last second of a power cut. The write-ahead log keeps its room after a
checkpoint, because a log that has wrapped once needs no new space when the disk is full at the next fence.
"""

import sqlite3
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Final

from sqlalchemy import Connection, Engine, create_engine
from sqlalchemy.exc import DBAPIError
from sqlalchemy.pool import NullPool, QueuePool, StaticPool

from core.journal.stores.faults import StoreError, StoreFault, connected

LEDGER_FILE: Final = "ledger.db"
CHECKPOINT_PAGES: Final = 1_000  # of 4 KiB, SQLite's default
LOG_KEPT_BYTES: Final = 8 * 1024 * 1024  # more than a checkpoint's worth, so a wrapped log keeps its room
_PROGRESS_STEPS: Final = 10_000  # virtual machine steps between two looks at the clock, well under 1 ms
#: Beyond those it is told of, for a moment: what is asked seldom and beside the requests.
_READERS_BEYOND: Final = 2
FREE_WITHIN_S: Final = 0.9  # a read waits so long for a connection, and is refused then
_CONNECT: Final = "connect"  # among an engine's options: how it opens a connection
_COPIED_PAGES: Final = 1_024  # between two signs of life while a ledger is copied
_COPIED_ANEW_MAX: Final = 2  # as often as somebody's writing may have a copy begin again
_IOERR_SHMSIZE: Final = 4874  # the shared index could not grow: what a full disk looks like at the first open


def error_of(raised: BaseException | None) -> StoreError:
    """Return what the driver raised as a value."""
    code = getattr(raised, "sqlite_errorcode", sqlite3.SQLITE_ERROR)
    name = getattr(raised, "sqlite_errorname", type(raised).__name__)
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
    return StoreError(fault, f"{name}: {raised}")


class WritingEngine:
    """The engine of the one connection that writes. What it is tried on before the store is a book in memory.

    Statements it has put into words there are ready when it opens the store.
    """

    def __init__(self, path: Path, *, lasting: bool = True) -> None:
        """Prepare for the store at `path`; nothing is opened yet. Not `lasting`: a copy that no power cut can hurt."""
        self._path = path
        self._synchronous = "FULL" if lasting else "OFF"
        self._opens: Path | str = path
        self._busy_timeout_ms = 0
        self._engine = create_engine(
            "sqlite://", creator=self._connect, poolclass=StaticPool, isolation_level="AUTOCOMMIT"
        )

    @contextmanager
    def tried(self) -> Iterator[Connection]:
        """Give a connection to an empty book in memory, which is gone afterwards."""
        self._opens = ":memory:"
        try:
            with self._engine.connect() as connection:
                yield connection
        finally:
            self._engine.dispose()
            self._opens = self._path

    def connect(self, busy_timeout_ms: int) -> Connection | StoreError:
        """Open the connection that writes, making the file if there is none.

        `busy_timeout_ms`: how long BEGIN IMMEDIATE waits for somebody else's lock.
        """
        self._busy_timeout_ms = busy_timeout_ms
        try:
            connection = self._engine.connect()
            for pragma in (
                "journal_mode = WAL",
                f"synchronous = {self._synchronous}",
                "foreign_keys = ON",
                "trusted_schema = OFF",
                f"wal_autocheckpoint = {CHECKPOINT_PAGES}",
                f"journal_size_limit = {LOG_KEPT_BYTES}",
            ):
                connection.exec_driver_sql(f"PRAGMA {pragma}").close()
        except DBAPIError as error:
            return error_of(error.orig)
        return connection

    def _connect(self) -> sqlite3.Connection:
        return sqlite3.connect(
            self._opens,
            timeout=self._busy_timeout_ms / 1000,
            isolation_level=None,
            check_same_thread=False,
        )


def open_writing(path: Path, busy_timeout_ms: int) -> Connection | StoreError:
    """Open the one connection that writes, making the file if there is none; see `WritingEngine.connect`."""
    return WritingEngine(path).connect(busy_timeout_ms)


def close_writing(connection: Connection) -> None:
    """Close what `open_writing` opened. It is the last to close that makes a ledger at rest one file."""
    connection.close()
    connection.engine.dispose()


def size_bytes(connection: Connection) -> int:
    """Return how large the ledger is, in its file and its log together, as this connection sees it."""
    pages, page_bytes = (
        connection.exec_driver_sql(f"PRAGMA {name}").scalar_one() for name in ("page_count", "page_size")
    )
    return int(pages) * int(page_bytes)


def open_reading(
    path: Path,
    connections_max: int,
    busy_timeout_ms: int,
    *,
    alone: bool = False,
    first: Sequence[str] = (),
) -> Engine:
    """Return an engine whose connections can't write and never checkpoint; nothing is opened yet.

    `alone`: nobody writes to the file while this engine lives, and all of it is in the file. It is then read
    without the log's shared index, which a disk that takes no write can't hold. `first`: what each connection is told
    before anything else, see `schema.views_over`.
    """
    uri = f"{path.absolute().as_uri()}?mode=ro{'&immutable=1' if alone else ''}"

    def connect() -> sqlite3.Connection:
        connection = sqlite3.connect(
            uri, uri=True, timeout=busy_timeout_ms / 1000, isolation_level=None, check_same_thread=False
        )
        for statement in first:
            connection.execute(statement).close()
        connection.execute("PRAGMA query_only = ON").close()
        connection.execute("PRAGMA wal_autocheckpoint = 0").close()
        return connection

    return create_engine(
        "sqlite://",
        creator=connect,
        poolclass=QueuePool,
        pool_size=connections_max,
        max_overflow=_READERS_BEYOND,
        pool_timeout=FREE_WITHIN_S,
        isolation_level="AUTOCOMMIT",
        execution_options={_CONNECT: connect},
    )


def beside(readers: Engine) -> Engine:
    """Return an engine that reads the same file by a connection of its own each time, which is closed at the end.

    For components: what hangs there and is left behind keeps its connection, and none that a request waits for.
    """
    connect = readers.get_execution_options()[_CONNECT]
    return create_engine("sqlite://", creator=connect, poolclass=NullPool, isolation_level="AUTOCOMMIT")


def copy_whole(ledger: Path, into: Path, tick: Callable[[], object]) -> StoreError | None:
    """Copy a ledger as it is committed now into a file of its own, read the copy again, and return what failed.

    By SQLite's own backup, so whoever holds the ledger's lock may be the one who asks, and nothing of the log is
    missing. The copy needs no log and no index beside it. `tick` is called again and again while it takes long.
    """
    try:
        with (
            closing(_only_read(ledger)) as source,
            closing(sqlite3.connect(into, isolation_level=None)) as copy,
        ):
            source.backup(copy, pages=_COPIED_PAGES, progress=lambda *_: tick())
            copy.execute("PRAGMA journal_mode = DELETE").close()
            return _misses(copy, source, tick)
    except sqlite3.Error as error:
        return error_of(error)


class _WrittenMeanwhileError(Exception):
    """A copy has begun anew too often."""


def copy_beside_work(ledger: Path, into: Path, tick: Callable[[], object]) -> StoreError | None:
    """Copy a ledger that others write to, as it stood at one moment, into a new file; return what failed.

    Nothing is flushed, and the copy is not read again: it is for whoever throws it away. In steps of some milliseconds,
    so that no read of ours keeps the log from being emptied; SQLite begins anew where somebody has written between two.
    Where that happens again and again, all of it is copied in one read. `tick` is called between the steps, and may raise.
    """
    try:
        with (
            closing(_only_read(ledger)) as source,
            closing(sqlite3.connect(into, isolation_level=None)) as copy,
        ):
            copy.execute("PRAGMA synchronous = OFF").close()
            copy.execute(
                "PRAGMA journal_mode = MEMORY"
            ).close()  # what was given up is undone before it is begun anew
            try:
                source.backup(copy, pages=_COPIED_PAGES, progress=_Anew(tick))
            except _WrittenMeanwhileError:
                source.execute("BEGIN").close()
                source.execute("SELECT * FROM sqlite_schema").fetchone()  # from here on it is one moment
                source.backup(copy, pages=_COPIED_PAGES, progress=lambda *_: tick())
                source.execute("ROLLBACK").close()
    except sqlite3.Error as error:
        return error_of(error)
    return None


def has_reset_race(version: tuple[int, ...]) -> bool:
    """Whether this version of SQLite may damage a file when two connections write or checkpoint at one moment.

    SQLite 3.7.0 to 3.51.2, but not 3.44.6 and 3.50.7, which were mended later ("WAL-reset bug", sqlite.org/wal.html). Here only the
    writer writes and checkpoints, and every reader is opened read only, so nothing of ours can bring it about.
    """
    if version[:2] in {(3, 44), (3, 50)}:
        return version[2] < {(3, 44): 6, (3, 50): 7}[version[0], version[1]]
    return (3, 7, 0) <= version[:3] <= (3, 51, 2)


def settle(copy: Path) -> StoreError | None:
    """Make one file of a copy that needs no log and no index beside it; return what failed. Nobody else has it open."""
    try:
        with closing(sqlite3.connect(copy, isolation_level=None)) as connection:
            connection.execute("PRAGMA journal_mode = DELETE").close()
    except sqlite3.Error as error:
        return error_of(error)
    return None


class _Anew:
    """Ends a copy that begins again too often: more is left than was left before."""

    def __init__(self, tick: Callable[[], object]) -> None:
        self._tick = tick
        self._left: int | None = None
        self._begun_anew = 0

    def __call__(self, _status: int, left: int, _total: int) -> None:
        self._tick()
        if self._left is not None and left >= self._left:
            self._begun_anew += 1
            if self._begun_anew > _COPIED_ANEW_MAX:
                raise _WrittenMeanwhileError
        self._left = left


def is_copy(copy: Path, ledger: Path, tick: Callable[[], object]) -> bool:
    """Whether `copy` is whole and holds what is committed in a ledger now; one that can't be read is none.

    `tick` is called again and again while it takes long.
    """
    if not copy.is_file():
        return False
    try:
        with closing(_only_read(copy)) as kept, closing(_only_read(ledger)) as source:
            return _misses(kept, source, tick) is None
    except sqlite3.Error:
        return False


def _only_read(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)


def _misses(
    copy: sqlite3.Connection, source: sqlite3.Connection, tick: Callable[[], object]
) -> StoreError | None:
    """Read a copy whole and say what it lacks. The refused commands' keys are counted: they move no head."""
    _watch(copy, tick)
    found = [row[0] for row in copy.execute("PRAGMA quick_check(1)")]
    if found != ["ok"]:
        return StoreError(StoreFault.DAMAGED, f"the copy says: {found[0]}")
    for asked in ("SELECT * FROM meta", "SELECT count(*) FROM idempotency"):
        if copy.execute(asked).fetchall() != source.execute(asked).fetchall():
            return StoreError(StoreFault.DAMAGED, "the copy holds something else")
    return None


def watch(connection: Connection, tick: Callable[[], object] | None) -> None:
    """Have `tick` called again and again while a statement of this connection takes long; None: no longer."""
    driver = connection.connection.driver_connection
    assert isinstance(driver, sqlite3.Connection)
    _watch(driver, tick)


def _watch(driver: sqlite3.Connection, tick: Callable[[], object] | None) -> None:
    if tick is None:
        driver.set_progress_handler(None, 0)
        return

    def go_on() -> int:
        tick()
        return 0

    driver.set_progress_handler(go_on, _PROGRESS_STEPS)


@contextmanager
def snapshot(engine: Engine, read_ms_max: int) -> Iterator[Connection]:
    """Give a connection that sees the book at one moment and is interrupted after `read_ms_max`.

    An open read transaction keeps the log from being checkpointed (one grew it to 244 MB in 6 s), so a
    statement that takes too long ends with SQLITE_INTERRUPT, raised as SQLAlchemy's OperationalError. Where no
    connection becomes free in time, that is one too: `StoreFault.TAKEN`.
    """
    with connected(engine) as connection:
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


def begin_writing(connection: Connection) -> None:
    """Begin a transaction that nobody else writes beside. Raises where the lock can't be had."""
    connection.exec_driver_sql("BEGIN IMMEDIATE").close()


def begin_reading(connection: Connection) -> None:
    """Begin a transaction that sees the book at one moment."""
    connection.exec_driver_sql("BEGIN").close()


def wait_at_most(connection: Connection, busy_timeout_ms: int) -> None:
    """Have this connection wait so long for somebody else's lock from here on."""
    connection.exec_driver_sql(f"PRAGMA busy_timeout = {busy_timeout_ms}").close()


def tables_of(connection: Connection) -> set[str]:
    """Return the names of all tables there are."""
    return set(connection.exec_driver_sql("SELECT name FROM sqlite_master WHERE type = 'table'").scalars())


def is_open(connection: Connection) -> bool:
    """Whether the connection is inside a transaction; SQLite ends one by itself after some errors."""
    driver = connection.connection.driver_connection
    assert isinstance(driver, sqlite3.Connection)
    return driver.in_transaction
