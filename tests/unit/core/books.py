"""Small books for tests: orders in one line, a journal on a real SQLite file."""

import itertools
import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sqlalchemy import Connection

from core.guarded.recorder import NoRecorder
from core.journal import schema
from core.journal.answers import Answer, LookUp, Order, Work
from core.journal.append import Committed, Journal
from core.journal.fence import FenceOutcome, Raised, fence
from core.journal.room import Room
from core.journal.store import LEDGER_FILE, StoreError, open_writing
from core.ledger.accounts import AccountType
from core.ledger.commands import (
    CloseAccount,
    Command,
    OpenAccount,
    Posting,
    PostTransaction,
    accounts_of,
    fingerprint_of,
    transaction_of,
)
from core.ledger.entries import (
    EntryBody,
    RecordEntry,
    ReplaceEntry,
    ReverseEntry,
    record_entry,
    replace_entry,
    reverse_entry,
)

_numbers = itertools.count(1)


def opening(
    name: str, kind: AccountType = AccountType.ASSET, currency: str = "KRW", *, no_overdraft: bool = False
) -> OpenAccount:
    return OpenAccount(name, name.upper(), kind, currency, no_overdraft)


def closing(name: str) -> CloseAccount:
    return CloseAccount(name)


def moving(amount: int, to: str, source: str, currency: str = "KRW") -> PostTransaction:
    lines = (Posting(to, amount, currency), Posting(source, -amount, currency))
    return PostTransaction(f"tx-{next(_numbers)}", "2026-11-21", "moved", (), lines)


def entering(amount: str, account: str | None = "bank", **changes: Any) -> RecordEntry:
    """An entry on an account; `origin`, `duplicates_wanted` and every member of the body can be set."""
    named = {name: changes.pop(name) for name in ("origin", "duplicates_wanted") if name in changes}
    body = EntryBody(**({"date": "2026-11-21", "amount": amount, "account": account} | changes))
    command = record_entry(body, f"entry-{next(_numbers)}", **named)
    assert isinstance(command, RecordEntry), command
    return command


def replacing(entry: str, amount: str, account: str | None = "bank", **changes: Any) -> ReplaceEntry:
    """A change of an entry; `expected_seq`, `keeps_the_rest` and every member of the body can be set."""
    named = {name: changes.pop(name) for name in ("expected_seq", "keeps_the_rest") if name in changes}
    body = EntryBody(**({"date": "2026-11-21", "amount": amount, "account": account} | changes))
    command = replace_entry(entry, body, f"tx-{next(_numbers)}", f"back-{next(_numbers)}", **named)
    assert isinstance(command, ReplaceEntry), command
    return command


def reversing(entry: str, expected_seq: int | None = None) -> ReverseEntry:
    return reverse_entry(entry, f"back-{next(_numbers)}", expected_seq)


def order(command: Command, key: str | None = None, slot: int = 0, digest: bytes = b"d") -> Order:
    transaction_id = transaction_of(command)
    command_id = f"cmd-{next(_numbers)}"
    fingerprint = fingerprint_of(command)
    return Order(command, key, fingerprint, digest, command_id, transaction_id, accounts_of(command), slot)


def opened(path: Path, busy_timeout_ms: int = 1_000) -> Connection:
    connection = open_writing(path / LEDGER_FILE, busy_timeout_ms)
    assert not isinstance(connection, StoreError), connection
    return connection


def bring_up(connection: Connection, version: int, _: int) -> None:
    """For a ledger that nobody would miss: no copy is kept."""
    schema.bring_up(connection, version)


def fenced(connection: Connection, expected: int | None) -> FenceOutcome:
    return fence(connection, expected, bring_up)


class Pen:
    """A journal that was fenced, and its recorder."""

    def __init__(self, path: Path, busy_timeout_ms: int = 1_000) -> None:
        self.connection = opened(path, busy_timeout_ms)
        raised = fenced(self.connection, None)
        assert isinstance(raised, Raised), raised
        self.epoch = raised.epoch
        self.recorder = NoRecorder()
        room = Room(path, time.monotonic_ns)
        self.journal = Journal(
            self.connection, raised.epoch, 0, self.recorder, room, lambda: 1_795_000_000_000_000_000
        )

    def write(self, *works: Work) -> tuple[Answer, ...]:
        outcome = self.journal.write(works)
        assert isinstance(outcome, Committed), outcome
        return outcome.answers

    def carry_out(self, *commands: Command) -> tuple[Answer, ...]:
        return self.write(*[order(command) for command in commands])

    def look_up(self, key: str) -> Answer:
        return self.write(LookUp(key, 0))[0]

    def close(self) -> None:
        self.journal.close()
        self.recorder.close()


@contextmanager
def pen(path: Path, busy_timeout_ms: int = 1_000) -> Iterator[Pen]:
    made = Pen(path, busy_timeout_ms)
    try:
        yield made
    finally:
        made.close()


def failing_at_commit(connection: Connection) -> None:
    """Have every COMMIT that writes an event fail: what it leaves behind breaks a rule that is checked there."""
    connection.exec_driver_sql("CREATE TEMP TABLE owner (id INTEGER PRIMARY KEY)").close()
    connection.exec_driver_sql(
        "CREATE TEMP TABLE owned (id INTEGER REFERENCES owner DEFERRABLE INITIALLY DEFERRED)"
    ).close()
    connection.exec_driver_sql(
        "CREATE TEMP TRIGGER owes AFTER INSERT ON event BEGIN INSERT INTO owned VALUES (1); END"
    ).close()


def tamper(path: Path, *statements: str) -> None:
    """Change the file as somebody with a database tool would: triggers off, foreign keys unchecked."""
    connection = sqlite3.connect(path / LEDGER_FILE, isolation_level=None)
    try:
        names = connection.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'").fetchall()
        for (name,) in names:
            connection.execute(f"DROP TRIGGER {name}")
        for statement in statements:
            connection.execute(statement)
    finally:
        connection.close()
