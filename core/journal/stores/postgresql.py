"""The store in a server: PostgreSQL, with one connection that writes, a few that can't, and its errors as values.

The fence is the row of `meta`. Every batch locks it FOR UPDATE as the first statement of its transaction, under READ
COMMITTED, and reads the epoch in the next statement: whoever was fenced meanwhile waits for that lock and sees the higher
number then. A plain SELECT, FOR KEY SHARE, or a lock under a snapshot that is older than it are the ways in which an entry
of an old epoch commits after the fence; each of them is a test. A core that hangs with that lock in its hands is
answered by ending its session, which is certain: what it has not committed is gone with it.

A connection that is lost before COMMIT was sent has done nothing, so the next batch just opens another one; each batch
looks at the epoch anyway. Commits are flushed by the server before they return, and a server that is not set up to do so is
refused at the opening. Not chosen: a lease with a time in it, and advisory locks as the fence; the one that is
taken here is a courtesy at the door, like the lock beside a file.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, Final

from sqlalchemy import Connection, Engine, create_engine, event, text
from sqlalchemy.exc import DBAPIError
from sqlalchemy.pool import NullPool, QueuePool

from core.journal.stores.faults import StoreError, StoreFault, connected
from core.journal.stores.whereabouts import Server

DIALECT: Final = "postgresql"
DRIVER: Final = "psycopg"
EXTRA: Final = "fieldstack-hardcore[postgresql]"
VERSION_OLDEST: Final = 150_000
WRITER: Final = "fieldstack-core writer"
READER: Final = "fieldstack-core reader"
FREE_WITHIN_S: Final = 0.9  # as with a file
_READERS_BEYOND: Final = 2
_CONNECT_S: Final = 2  # the least that its library knows
#: A core that stops in the middle of a batch lets go of the row after that, whoever looks.
_IDLE_IN_BATCH_MS: Final = 30_000
#: A dead machine is noticed within so long on either side, where TCP alone would take hours.
_ALIVE: Final = {
    "keepalives_idle": 5,
    "keepalives_interval": 2,
    "keepalives_count": 3,
    "tcp_user_timeout": 10_000,
}
_SERVER: Final = "server"  # among an engine's options: where it leads
_WAITS: Final = "waits"  # and how long its sessions wait for a lock
_LOCKS: Final = 1_179_861_836  # the first number of our advisory locks
_SEAT: Final = 1
_FOUNDING: Final = 2

_BUSY: Final = frozenset({"55P03", "40001", "40P01"})
_AWAY: Final = frozenset({"57P01", "57P02", "57P03", "53300", "25P03", "25P04"})
_DAMAGED: Final = frozenset({"XX001", "XX002"})
_UNFIT: Final = frozenset({"28000", "28P01", "3D000", "3F000", "42501"})
_INTERRUPTED: Final = "57014"
_IDLE: Final = 0  # the states of a transaction, as its library numbers them
_IN_TRANSACTION: Final = 2


def is_raised_by_it(raised: BaseException | None) -> bool:
    """Whether this is an exception of the server's driver."""
    return type(raised).__module__.partition(".")[0] == DRIVER


def error_of(raised: BaseException | None) -> StoreError:
    """Return what the driver raised as a value."""
    state = getattr(raised, "sqlstate", None)
    return StoreError(_fault_of(state), f"{state or type(raised).__name__}: {' '.join(str(raised).split())}")


def _fault_of(state: str | None) -> StoreFault:
    match state:
        case None:
            return StoreFault.AWAY  # what comes from no server is about the way to it
        case _ if state in _BUSY:
            return StoreFault.BUSY
        case "53100":
            return StoreFault.NO_ROOM
        case "25006":
            return StoreFault.READ_ONLY
        case _ if state in _DAMAGED:
            return StoreFault.DAMAGED
        case _ if state in _AWAY or state.startswith("08"):
            return StoreFault.AWAY
        case _ if state in _UNFIT:
            return StoreFault.UNFIT
        case _:
            return StoreFault.OTHER


class PostgresWriting:
    """The engine of the one connection that writes."""

    def __init__(self, server: Server) -> None:
        """Prepare for the database of a server; nothing is opened yet."""
        self._server = server

    def connect(self, busy_timeout_ms: int) -> Connection | StoreError:
        """Open the connection that writes, and see that what it commits will be kept.

        `busy_timeout_ms`: how long the beginning of a transaction waits for somebody else's lock.
        """
        engine = _engine(self._server, WRITER, busy_timeout_ms, poolclass=NullPool)
        if isinstance(engine, StoreError):
            return engine
        try:
            connection = engine.connect()
            unfit = _unfit(connection)
        except DBAPIError as error:
            return error_of(error.orig)
        if unfit is not None:
            connection.close()
        return unfit or connection

    @contextmanager
    def tried(self) -> Iterator[Connection | None]:
        """Give nothing: what would be tried on is the server's own, and nobody may write there before the fence."""
        yield None


def open_reading(server: Server, connections_max: int, busy_timeout_ms: int) -> Engine:
    """Return an engine whose connections can't write; nothing is opened yet."""
    engine = _engine(
        server,
        READER,
        busy_timeout_ms,
        poolclass=QueuePool,
        pool_size=connections_max,
        max_overflow=_READERS_BEYOND,
        pool_timeout=FREE_WITHIN_S,
    )
    assert isinstance(engine, Engine), "whoever reads has looked before whether there is a driver"
    return engine


def beside(readers: Engine) -> Engine:
    """Return an engine that reads the same database by a connection of its own each time."""
    options = readers.get_execution_options()
    engine = _engine(options[_SERVER], READER, options[_WAITS]["ms"], poolclass=NullPool)
    assert isinstance(engine, Engine), "there was a driver a moment ago"
    return engine


def _engine(server: Server, name: str, busy_timeout_ms: int, **pool: Any) -> Engine | StoreError:
    waits = {"ms": busy_timeout_ms}
    try:
        engine = create_engine(
            server.url,
            isolation_level="AUTOCOMMIT",
            use_native_hstore=False,
            hide_parameters=True,
            execution_options={_SERVER: server, _WAITS: waits},
            **pool,
        )
    except ModuleNotFoundError:
        missing = f"its driver is not there: install {EXTRA}, as in pip install '{EXTRA}'"
        return StoreError(StoreFault.UNFIT, missing)

    @event.listens_for(engine, "do_connect")
    def prepare(_dialect: Any, _record: Any, _arguments: Any, named: dict[str, Any]) -> None:
        ours = {
            "lock_timeout": waits["ms"],
            "synchronous_commit": "on",
            "idle_in_transaction_session_timeout": _IDLE_IN_BATCH_MS,
            "client_min_messages": "warning",
            **({"default_transaction_read_only": "on"} if name == READER else {}),
        }
        given = named.get("options", "")
        named["options"] = " ".join([given, *(f"-c {key}={value}" for key, value in ours.items())]).strip()
        named["application_name"] = name
        for key, value in (_ALIVE | {"connect_timeout": _CONNECT_S}).items():
            named.setdefault(key, value)

    return engine


def _unfit(connection: Connection) -> StoreError | None:
    """Return what about this server would lose what it has acknowledged, or would order names otherwise."""
    row = connection.exec_driver_sql(
        "SELECT current_setting('server_version_num')::int AS version, pg_is_in_recovery() AS standby,"
        " current_setting('synchronous_commit') AS flushed, current_setting('fsync') AS fsync,"
        " current_setting('full_page_writes') AS pages, current_setting('server_encoding') AS encoding"
    ).one()
    if row.standby:
        return StoreError(StoreFault.READ_ONLY, "the server is a standby of another one")
    wrong = []
    if row.version < VERSION_OLDEST:
        wrong.append(f"its version is older than {VERSION_OLDEST // 10_000}")
    if row.flushed != "on":
        wrong.append(f"its synchronous_commit is {row.flushed} and must be on")
    if row.fsync != "on":
        wrong.append("its fsync is off and must be on")
    if row.pages != "on":
        wrong.append("its full_page_writes is off and must be on")
    if row.encoding != "UTF8":
        wrong.append(f"the database's encoding is {row.encoding} and must be UTF8")
    return StoreError(StoreFault.UNFIT, ", ".join(wrong)) if wrong else None


def take_seat(connection: Connection, *, shared: bool) -> None:
    """Take the lock that keeps two cores from one database by accident, shared by those under a guard.

    Raises where another one holds it. It goes with the session, and is not taken again by one that follows it.
    """
    how = "pg_advisory_lock_shared" if shared else "pg_advisory_lock"
    connection.exec_driver_sql(f"SELECT {how}({_LOCKS}, {_SEAT})").close()


def begin_fence(connection: Connection) -> None:
    """Begin the transaction of a fence: alone with the row of the epoch, or with a database that has none yet."""
    _begin_anew(connection)
    try:
        connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({_LOCKS}, {_FOUNDING})").close()
        if connection.exec_driver_sql("SELECT to_regclass('meta')").scalar() is not None:
            connection.exec_driver_sql("SELECT epoch FROM meta FOR UPDATE").close()
    except DBAPIError:
        _give_up(connection)
        raise


def begin_writing(connection: Connection) -> None:
    """Begin the transaction of a batch, with the row of the epoch locked. Raises where that can't be had.

    Whatever is read in it afterwards is read by statements of their own, and so is newer than the lock.
    """
    _begin_anew(connection)
    try:
        connection.exec_driver_sql("SELECT epoch FROM meta FOR UPDATE").close()
    except DBAPIError:
        _give_up(connection)
        raise


def _begin_anew(connection: Connection) -> None:
    """Begin a transaction, on another connection where this one is gone: nothing was open in it."""
    begin = "BEGIN ISOLATION LEVEL READ COMMITTED READ WRITE"
    if is_open(
        connection
    ):  # of a batch that was lost on the way: whatever is left of its session, it is not ours
        connection.invalidate()
    try:
        if connection.invalidated:
            connection.rollback()
        connection.exec_driver_sql(begin).close()
    except DBAPIError as error:
        if not error.connection_invalidated:
            raise
        connection.rollback()
        connection.exec_driver_sql(begin).close()


def _give_up(connection: Connection) -> None:
    if not connection.invalidated:
        with suppress(DBAPIError):
            connection.exec_driver_sql("ROLLBACK").close()


def commit(connection: Connection) -> None:
    """Commit. A server answers the COMMIT of a transaction that has failed with a ROLLBACK, and raises nothing."""
    assert _status(connection) == _IN_TRANSACTION, "a transaction that has failed is never committed"
    connection.exec_driver_sql("COMMIT").close()


def begin_reading(connection: Connection) -> None:
    """Begin a transaction that sees the book at one moment."""
    connection.exec_driver_sql("BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY").close()


def wait_at_most(connection: Connection, busy_timeout_ms: int) -> None:
    """Have this connection, and whichever follows it, wait so long for somebody else's lock from here on."""
    connection.engine.get_execution_options()[_WAITS]["ms"] = busy_timeout_ms
    connection.exec_driver_sql(f"SET lock_timeout = {busy_timeout_ms}").close()


def end_holders(connection: Connection) -> int:
    """End the sessions of other cores that hold the row of the epoch; return how many those were.

    For who knows that such a core was killed, or must be: its session may outlive it, and a frozen one holds on for ever.
    """
    ended: int = connection.execute(
        _END_HOLDERS, {"locks": _LOCKS, "founding": _FOUNDING, "writer": WRITER}
    ).scalar_one()
    return ended


def tables_of(connection: Connection) -> set[str]:
    """Return the names of all tables there are where ours would be made."""
    return set(
        connection.exec_driver_sql(
            "SELECT tablename FROM pg_tables WHERE schemaname = current_schema()"
        ).scalars()
    )


def size_bytes(connection: Connection) -> int:
    """Return how large the database is."""
    return int(connection.exec_driver_sql("SELECT pg_database_size(current_database())").scalar_one())


@contextmanager
def snapshot(engine: Engine, read_ms_max: int) -> Iterator[Connection]:
    """Give a connection that sees the book at one moment, and each of whose statements ends after `read_ms_max`."""
    connection = _reading(engine)
    try:
        connection.exec_driver_sql(f"SET LOCAL statement_timeout = {read_ms_max}").close()
        yield connection
    finally:
        _give_up(connection)
        connection.close()


def _reading(engine: Engine) -> Connection:
    """Return a connection that reads, a fresh one where that at hand is gone: its server was started anew."""
    connection = connected(engine)
    try:
        begin_reading(connection)
    except DBAPIError as error:
        connection.close()
        if not error.connection_invalidated:
            raise
        connection = connected(engine)
        begin_reading(connection)
    return connection


def is_interrupted(raised: BaseException | None) -> bool:
    """Whether a read was ended because it took too long."""
    return getattr(raised, "sqlstate", None) == _INTERRUPTED


def is_open(connection: Connection) -> bool:
    """Whether the connection is inside a transaction, a failed one too."""
    return not connection.invalidated and _status(connection) != _IDLE


def _status(connection: Connection) -> int:
    driver: Any = connection.connection.driver_connection
    return int(driver.info.transaction_status)


_END_HOLDERS: Final = text(
    "SELECT count(pg_terminate_backend(pid)) FROM pg_stat_activity WHERE pid IN ("
    " SELECT pid FROM pg_locks WHERE granted AND pid <> pg_backend_pid()"
    " AND database = (SELECT oid FROM pg_database WHERE datname = current_database())"
    " AND (locktype = 'relation' AND relation = to_regclass('meta')"
    "  AND mode IN ('RowShareLock', 'RowExclusiveLock')"
    "  OR locktype = 'advisory' AND classid = :locks AND objid = :founding)"
    ") AND application_name = :writer AND usename = current_user"
)
