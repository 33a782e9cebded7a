"""Where the ledgers of tests lie: in a file, or in a PostgreSQL server when TEST_STORE=postgresql says so.

The rules of the guard know nothing of a store, so the tests of them ask for none; `make test-postgresql` runs the same
tests with every ledger in a server. A test that is about the file itself (its disk, its lock, its bytes) says so
with `pytest.mark.in_a_file`, and is left out then.
"""

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, Final, Protocol

import psycopg

from core.journal.store import LEDGER_FILE
from core.store_file import STORE_FILE
from tests import postgres


class Session(Protocol):
    """A stranger's session in a ledger."""

    def execute(self, statement: str, /) -> Any:
        """Do it at once; what came of it has `fetchone`, `fetchall` and `rowcount`."""


WANTED: Final = os.environ.get("TEST_STORE") == "postgresql"
_server: list[postgres.Postgres] = []


def in_server() -> bool:
    """Whether the ledgers of this moment's tests lie in a server."""
    return bool(_server)


@contextmanager
def served() -> Iterator[Path]:
    """Have every ledger that is begun meanwhile lie in a server; the folder that its processes name."""
    with postgres.served() as server:
        _server.append(server)
        try:
            yield server.folder
        finally:
            _server.remove(server)


def prepare(data: Path) -> None:
    """Before a ledger begins in this folder: have it lie where these tests want it."""
    if _server and not (data.is_file() or (data / STORE_FILE).exists() or (data / LEDGER_FILE).exists()):
        data.mkdir(mode=0o700, parents=True, exist_ok=True)
        (data / STORE_FILE).write_text(_server[-1].database(), encoding="utf-8")


@contextmanager
def joined(data: Path, within_s: float = 5.0) -> Iterator[Session]:
    """Have a session of one's own in the ledger of this folder, as another program would; it waits so long for a lock."""
    address = data / STORE_FILE
    if address.exists():
        with psycopg.connect(address.read_text("utf-8").strip(), autocommit=True) as session:
            session.execute(f"SET lock_timeout = {max(1, round(within_s * 1000))}".encode())
            yield session
    else:
        with closing(sqlite3.connect(data / LEDGER_FILE, isolation_level=None, timeout=within_s)) as file:
            yield file


@contextmanager
def locked(data: Path, within_s: float = 5.0) -> Iterator[Session]:
    """Hold what each batch locks first. It is given back with a ROLLBACK, or at the end."""
    with joined(data, within_s) as session:
        if (data / STORE_FILE).exists():
            session.execute("BEGIN")
            session.execute("SELECT epoch FROM meta FOR UPDATE")
        else:
            session.execute("BEGIN IMMEDIATE")
        yield session


def tamper(data: Path, *statements: str) -> None:
    """Change the ledger as somebody with a database tool would, past all that refuses it. Each of them changes something."""
    with joined(data) as session:
        if (data / STORE_FILE).exists():
            session.execute("SET session_replication_role = replica")
        else:
            for (name,) in session.execute(
                "SELECT name FROM sqlite_master WHERE type = 'trigger'"
            ).fetchall():
                session.execute(f"DROP TRIGGER {name}")
        for statement in statements:
            assert session.execute(statement).rowcount > 0, statement


def epoch(data: Path) -> int:
    """The store's own epoch."""
    with joined(data) as session:
        found: int = session.execute("SELECT epoch FROM meta").fetchone()[0]
    return found
