"""Where receipts outlive the gateway: one SQLite file, one thread, and an fsync before each promise.

Everything here blocks and runs on the thread that `ReceiptFile` owns; the gateway's loop only awaits it. A promise is
given after a commit that was synced. A commit that fails says in which of two ways: the disk took nothing (`REFUSED`:
the wish is not done and never will be), or nobody knows (`DOUBTFUL`: a row whose sync failed has come back after a
death before). The body is dropped as soon as the outcome is known, and overwritten (`secure_delete`): it may hold
what nobody else should read. A journal file of our own was not chosen: receipts change, and rows are what changes.
"""

import asyncio
import json
import os
import sqlite3
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from enum import Enum, auto
from pathlib import Path
from typing import Any, Final, TypeVar

from hardcore.crisis.receipts import Moment, Outcome, Receipt, Wish

T = TypeVar("T")

#: How long a lock of somebody else's is waited for.
BUSY_MS: Final = 1_000
VERSION: Final = 1
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
    seen INTEGER NOT NULL
)
"""
_COLUMNS: Final = (
    "number, key, key_hash, digest, browser, method, target, host, headers, size_bytes, back, "
    "kept, since, changed, outcome, status, answer, seen"
)


class Failure(Enum):
    """Why something could not be stored."""

    REFUSED = auto()  # nothing of it is on the disk
    DOUBTFUL = auto()  # nobody knows


class ReceiptFile:
    """The file, and the thread that alone touches it. No call raises what a disk may raise."""

    def __init__(self, loop: asyncio.AbstractEventLoop, path: Path) -> None:
        self._loop = loop
        self._path = path
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="receipts")
        self._connection: sqlite3.Connection | None = None

    async def load(self) -> list[Receipt] | None:
        """Open the file and return all receipts, without their bodies; None: it can't be used."""
        return await self._do(self._load, None, None)

    async def keep(self, wish: Wish, body: bytes, now: Moment) -> Receipt | Failure:
        """Store a promise; returns once it is synced."""
        return await self._do(
            lambda connection: _insert(connection, wish, body, now), Failure.REFUSED, Failure.DOUBTFUL
        )

    async def change(self, receipts: Sequence[Receipt]) -> Failure | None:
        """Store how receipts stand now; the bodies of settled ones go."""
        return await self._do(
            lambda connection: _update(connection, receipts), Failure.REFUSED, Failure.DOUBTFUL
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
            code = getattr(error, "sqlite_errorcode", None)
            primary = code & 0xFF if isinstance(code, int) else None
            return refused if primary in _REFUSALS else doubtful
        except OSError:
            return refused  # the file could not be made or opened

    def _opened(self) -> sqlite3.Connection:
        if self._connection is None:
            self._connection = _open(self._path)
        return self._connection

    def _load(self, connection: sqlite3.Connection) -> list[Receipt]:
        rows = connection.execute(f"SELECT {_COLUMNS} FROM receipts ORDER BY number")  # noqa: S608 - ours
        return [_receipt(row) for row in rows]

    def _close(self) -> None:
        if self._connection is not None:
            self._connection.close()


def _open(path: Path) -> sqlite3.Connection:
    # Made by us first, so that it and the files beside it are readable by nobody else.
    os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600))
    connection = sqlite3.connect(path, timeout=BUSY_MS / 1000, isolation_level=None)
    try:
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = FULL")
        connection.execute("PRAGMA secure_delete = ON")
        (version,) = connection.execute("PRAGMA user_version").fetchone()
        if version > VERSION:
            raise sqlite3.DatabaseError(f"receipts of version {version} are newer than this program")
        connection.execute("BEGIN IMMEDIATE")
        connection.execute(_SCHEMA)
        connection.execute(f"PRAGMA user_version = {VERSION}")
        connection.execute("COMMIT")
    except sqlite3.Error:
        connection.close()
        raise
    return connection


def _insert(connection: sqlite3.Connection, wish: Wish, body: bytes, now: Moment) -> Receipt:
    receipt = Receipt(0, wish, now, now, now)
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
        "kept": _moment_text(now),
    }
    names = ", ".join(fields)
    places = ", ".join(f":{name}" for name in fields)
    statement = f"INSERT INTO receipts ({names}) VALUES ({places})"  # noqa: S608 - names are ours
    number = _in_one(connection, lambda: connection.execute(statement, fields).lastrowid)
    assert number is not None
    return replace(receipt, number=number)


def _update(connection: sqlite3.Connection, receipts: Sequence[Receipt]) -> None:
    def all_of_them() -> None:
        for one in receipts:
            fields = _fields(one)
            told = ", ".join(f"{name} = :{name}" for name in fields)
            body = "" if one.open else ", body = NULL"
            connection.execute(
                f"UPDATE receipts SET {told}{body} WHERE number = :number",  # noqa: S608 - names are ours
                fields | {"number": one.number},
            )

    _in_one(connection, all_of_them)


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
    }


def _moment_text(moment: Moment) -> str:
    return f"{moment.boot} {moment.awake_ns} {moment.wall_ns}"


def _moment(text: str) -> Moment:
    boot, awake_ns, wall_ns = text.rsplit(" ", 2)
    return Moment(boot, int(awake_ns), int(wall_ns))


def _receipt(row: Sequence[Any]) -> Receipt:  # Any: what SQLite gives
    number, key, key_hash, digest, browser, method, target, host, headers, size_bytes, back = row[:11]
    kept, since, changed, outcome, status, answer, seen = row[11:]
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
    )
