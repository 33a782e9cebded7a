"""Where receipts outlive the gateway: one SQLite file, one thread, and an fsync before each promise.

Everything here blocks and runs on the thread that `ReceiptFile` owns; the gateway's loop only awaits it. A promise is
given after a commit that was synced. A commit that fails says in which of two ways: the disk took nothing (`REFUSED`:
the wish is not done and never will be), or nobody knows (`DOUBTFUL`: a row whose sync failed has come back after a
death before). Body and headers are dropped as soon as the outcome is known, and overwritten (`secure_delete`): they
may hold what nobody else should read. Reading needs no write: what was promised is found on a full disk too. Two
gateways may have the file open for a moment (the older one leaves), so every change says what it changes: one that
the other has made meanwhile is not overwritten. A journal file of our own was not chosen: receipts change, and rows are what changes.
"""

import asyncio
import errno
import json
import os
import sqlite3
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from enum import Enum, auto
from pathlib import Path
from typing import Any, Final, TypeVar

from msgspec import structs

from hardcore.crisis.receipts import Moment, Outcome, Receipt, Wish

T = TypeVar("T")

#: How long a lock of somebody else's is waited for.
BUSY_MS: Final = 1_000
VERSION: Final = 2
#: Failures after which nothing of the transaction can be on the disk: it was not begun, or its last page never left.
_REFUSALS: Final = frozenset(
    {
        sqlite3.SQLITE_FULL,
        sqlite3.SQLITE_BUSY,
        sqlite3.SQLITE_LOCKED,
        sqlite3.SQLITE_READONLY,
        sqlite3.SQLITE_CANTOPEN,
        sqlite3.SQLITE_PERM,
    }
)
#: Failures that time alone does not mend: the file is none of ours, or nobody may open it.
_HOPELESS: Final = frozenset({sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN}) | frozenset(
    {sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_ERROR, sqlite3.SQLITE_PERM}
)
_HOPELESS_OS: Final = frozenset({errno.EROFS}) | frozenset(
    {errno.EISDIR, errno.EACCES, errno.EPERM, errno.ENOTDIR, errno.ENOENT, errno.ELOOP}
)

_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS receipts (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    key TEXT NOT NULL UNIQUE,
    key_hash TEXT NOT NULL,
    digest TEXT NOT NULL,
    browser BLOB,
    method TEXT NOT NULL,
    target BLOB NOT NULL,
    host BLOB NOT NULL,
    headers TEXT NOT NULL,
    body BLOB,
    size_bytes INTEGER NOT NULL,
    back TEXT NOT NULL,
    kept TEXT NOT NULL,
    since TEXT NOT NULL,
    changed TEXT NOT NULL,
    outcome TEXT NOT NULL,
    status INTEGER,
    answer TEXT,
    seen INTEGER NOT NULL,
    sent_epoch INTEGER NOT NULL DEFAULT 0
)
"""
_SENT_EPOCH: Final = "ALTER TABLE receipts ADD COLUMN sent_epoch INTEGER NOT NULL DEFAULT 0"
_COLUMNS: Final = (
    "number, key, key_hash, digest, browser, method, target, host, headers, size_bytes, back, "
    "kept, since, changed, outcome, status, answer, seen, "
)


class Failure(Enum):
    """Why something could not be stored."""

    REFUSED = auto()  # nothing of it is on the disk
    DOUBTFUL = auto()  # nobody knows


class Clash(Enum):
    """Why a change was not made, though the disk would have taken it."""

    OVERTAKEN = auto()  # the receipt is not what it was taken for: another gateway has changed it


class Unread(Enum):
    """Why the receipts are not known."""

    FOR_NOW = auto()  # a lock, no room, a fault of the disk: what was promised is in there
    FOR_GOOD = auto()  # it is no file of ours


class ReceiptFile:
    """The file, and the thread that alone touches it. No call raises what a disk may raise."""

    def __init__(self, loop: asyncio.AbstractEventLoop, path: Path) -> None:
        self._loop = loop
        self._path = path
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="receipts")
        self._connection: sqlite3.Connection | None = None
        self._made = False  # the table is there, as this version has it
        self._data_version: int | None = None  # changes with what others write

    async def load(self) -> list[Receipt] | Unread:
        """Return all receipts, without their bodies. Writes nothing; may be tried again."""
        return await self._loop.run_in_executor(self._thread, self._load)

    async def news(self) -> list[Receipt] | None:
        """Return all receipts if another process has written to the file since the last look; else None."""
        return await self._do(self._news, None, None)

    async def keep(self, wish: Wish, body: bytes, now: Moment, sent_epoch: int) -> Receipt | Failure:
        """Store a promise; returns once it is synced."""
        receipt = Receipt(0, wish, now, now, now, sent_epoch=sent_epoch)
        return await self._do(
            lambda connection: _insert(connection, receipt, body), Failure.REFUSED, Failure.DOUBTFUL
        )

    async def change(self, receipt: Receipt, over: Collection[Outcome]) -> Failure | Clash | None:
        """Store how a receipt stands now, if its outcome on the disk is one of `over`; the body of a settled one goes."""
        return await self._do(
            lambda connection: _update(connection, receipt, over), Failure.REFUSED, Failure.DOUBTFUL
        )

    async def body(self, key: str) -> bytes | None:
        """Return the body of an open receipt; None if it can't be read."""
        return await self._do(lambda connection: _body(connection, key), None, None)

    async def forget(self, keys: Sequence[str]) -> Failure | None:
        """Delete receipts."""
        return await self._do(lambda connection: _delete(connection, keys), Failure.REFUSED, Failure.DOUBTFUL)

    async def tidy(self) -> None:
        """Empty the log beside the file, in which deleted bodies still stand."""
        await self._do(_tidy, None, None)

    def close(self) -> None:
        """Close the file behind whatever is under way; a disk that hangs is not waited for."""
        self._thread.submit(self._close)
        self._thread.shutdown(wait=False)

    async def _do(self, deed: Callable[[sqlite3.Connection], T], refused: T, doubtful: T) -> T:
        return await self._loop.run_in_executor(self._thread, self._tried, deed, refused, doubtful)

    def _tried(self, deed: Callable[[sqlite3.Connection], T], refused: T, doubtful: T) -> T:
        try:
            return deed(self._opened())
        except sqlite3.Error as error:
            return refused if _primary(error) in _REFUSALS else doubtful
        except OSError:
            return refused  # the file could not be made or opened

    def _opened(self) -> sqlite3.Connection:
        """The connection, for whoever may write: the table is made, or brought up to this version."""
        connection = self._looked_into()
        if not self._made:
            _make(connection)
            self._made = True
        return connection

    def _looked_into(self) -> sqlite3.Connection:
        if self._connection is None:
            self._connection = _open(self._path)
        return self._connection

    def _load(self) -> list[Receipt] | Unread:
        try:
            if not self._path.exists():
                return []
            if os.statvfs(self._path).f_flag & os.ST_RDONLY:
                return (
                    Unread.FOR_GOOD
                )  # nothing is done on such a disk, so nothing can be done twice; it is tried again
            connection = self._looked_into()
            self._data_version = _data_version(connection)
            return _all(connection)
        except sqlite3.Error as error:
            code = _primary(error)
            return Unread.FOR_GOOD if code is None or code in _HOPELESS else Unread.FOR_NOW
        except OSError as error:
            return Unread.FOR_GOOD if error.errno in _HOPELESS_OS else Unread.FOR_NOW
        except (ValueError, TypeError):
            return Unread.FOR_GOOD  # there is something else in it than we write

    def _news(self, connection: sqlite3.Connection) -> list[Receipt] | None:
        version = _data_version(connection)
        if version == self._data_version:
            return None
        told = _all(connection)
        self._data_version = version
        return told

    def _close(self) -> None:
        if self._connection is not None:
            self._connection.close()


def _primary(error: sqlite3.Error) -> int | None:
    """The kind of a failure; None if it is not SQLite's own."""
    code = getattr(error, "sqlite_errorcode", None)
    return code & 0xFF if isinstance(code, int) else None


def _open(path: Path) -> sqlite3.Connection:
    # Made by us first, so that it and the files beside it are readable by nobody else.
    os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600))
    connection = sqlite3.connect(path, timeout=BUSY_MS / 1000, isolation_level=None)
    try:
        connection.execute("PRAGMA synchronous = FULL")
        connection.execute("PRAGMA secure_delete = ON")
        version = _version(connection)
        if version > VERSION:
            raise sqlite3.DatabaseError(f"receipts of version {version} are newer than this program")
    except sqlite3.Error:
        connection.close()
        raise
    return connection


def _make(connection: sqlite3.Connection) -> None:
    """Bring the file up to this version; one that is there already is not written to."""
    version = _version(connection)
    if version == VERSION:
        return
    connection.execute("PRAGMA journal_mode = WAL")

    def all_of_it() -> None:
        if (now := _version(connection)) < VERSION:  # nobody else has done it meanwhile
            connection.execute(_SCHEMA if now == 0 else _SENT_EPOCH)
        connection.execute(f"PRAGMA user_version = {VERSION}")

    _in_one(connection, all_of_it)


def _version(connection: sqlite3.Connection) -> int:
    return int(connection.execute("PRAGMA user_version").fetchone()[0])


def _data_version(connection: sqlite3.Connection) -> int:
    return int(connection.execute("PRAGMA data_version").fetchone()[0])


def _all(connection: sqlite3.Connection) -> list[Receipt]:
    version = _version(connection)
    if version == 0:
        return []
    columns = _COLUMNS + ("sent_epoch" if version == VERSION else "0")
    rows = connection.execute(f"SELECT {columns} FROM receipts ORDER BY number")  # noqa: S608 - ours
    return [_receipt(row) for row in rows]


def _insert(connection: sqlite3.Connection, receipt: Receipt, body: bytes) -> Receipt:
    wish = receipt.wish
    fields = _fields(receipt) | {
        "key": wish.key,
        "key_hash": wish.key_hash,
        "digest": wish.digest,
        "browser": wish.browser,
        "method": wish.method,
        "target": wish.target,
        "host": wish.host,
        "headers": json.dumps(
            [[name.decode("latin-1"), value.decode("latin-1")] for name, value in wish.headers]
        ),
        "body": body,
        "size_bytes": wish.size_bytes,
        "back": wish.back,
        "kept": _moment_text(receipt.kept),
    }
    names = ", ".join(fields)
    places = ", ".join(f":{name}" for name in fields)
    statement = f"INSERT INTO receipts ({names}) VALUES ({places})"  # noqa: S608 - names are ours
    number = _in_one(connection, lambda: connection.execute(statement, fields).lastrowid)
    assert number is not None
    return structs.replace(receipt, number=number)


def _update(connection: sqlite3.Connection, receipt: Receipt, over: Collection[Outcome]) -> Clash | None:
    fields = _fields(receipt)
    told = ", ".join(f"{name} = :{name}" for name in fields)
    private = "" if receipt.open else ", body = NULL, headers = '[]'"
    outcomes = ", ".join(f"'{outcome}'" for outcome in over)
    statement = (
        f"UPDATE receipts SET {told}{private} "  # noqa: S608 - names and outcomes are ours
        f"WHERE number = :number AND outcome IN ({outcomes})"
    )
    told_of = fields | {"number": receipt.number}
    changed = _in_one(connection, lambda: connection.execute(statement, told_of).rowcount)
    return None if changed else Clash.OVERTAKEN


def _delete(connection: sqlite3.Connection, keys: Sequence[str]) -> None:
    _in_one(
        connection,
        lambda: connection.executemany("DELETE FROM receipts WHERE key = ?", [(key,) for key in keys]),
    )


def _tidy(connection: sqlite3.Connection) -> None:
    connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")


def _in_one(connection: sqlite3.Connection, deed: Callable[[], T]) -> T:
    """Do it in one transaction that is synced, or that is not there."""
    connection.execute("BEGIN IMMEDIATE")
    try:
        made = deed()
        connection.execute("COMMIT")
    except sqlite3.Error:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise
    return made


def _body(connection: sqlite3.Connection, key: str) -> bytes | None:
    row = connection.execute("SELECT body FROM receipts WHERE key = ?", (key,)).fetchone()
    return None if row is None else row[0]


def _fields(receipt: Receipt) -> dict[str, Any]:  # Any: what SQLite takes
    """The columns that change."""
    return {
        "since": _moment_text(receipt.since),
        "changed": _moment_text(receipt.changed),
        "outcome": str(receipt.outcome),
        "status": receipt.status,
        "answer": None if receipt.answer is None else json.dumps(receipt.answer, ensure_ascii=False),
        "seen": int(receipt.seen),
        "sent_epoch": receipt.sent_epoch,
    }


def _moment_text(moment: Moment) -> str:
    return f"{moment.boot} {moment.awake_ns} {moment.wall_ns}"


def _moment(text: str) -> Moment:
    boot, awake_ns, wall_ns = text.rsplit(" ", 2)
    return Moment(boot, int(awake_ns), int(wall_ns))


def _receipt(row: Sequence[Any]) -> Receipt:  # Any: what SQLite gives
    number, key, key_hash, digest, browser, method, target, host, headers, size_bytes, back = row[:11]
    kept, since, changed, outcome, status, answer, seen, sent_epoch = row[11:]
    lines = tuple((name.encode("latin-1"), value.encode("latin-1")) for name, value in json.loads(headers))
    wish = Wish(key, key_hash, digest, browser, method, target, host, lines, size_bytes, back)
    return Receipt(
        number,
        wish,
        _moment(kept),
        _moment(since),
        _moment(changed),
        Outcome(outcome),
        status,
        None if answer is None else json.loads(answer),
        bool(seen),
        sent_epoch,
    )
