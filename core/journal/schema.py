"""The tables: the events are the truth, the others are readings of them made in the same transaction.

STRICT tables and triggers are the second line of defence: no program that opens this file, ours after a bug
included, can change an event, skip a number, write in an old epoch or overdraw an account that may not be.
The readings (accounts, transactions, postings) can be rebuilt from the events; keys can't and are kept for
ever. A version per table was not chosen: one number for the whole is what the fence can check.
"""

from typing import Final

from sqlalchemy import (
    BigInteger,
    CheckConstraint,
    Column,
    Connection,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    Table,
    Text,
)

SCHEMA_VERSION: Final = 2

metadata: Final = MetaData()

meta: Final = Table(
    "meta",
    metadata,
    Column("id", Integer, CheckConstraint("id = 1"), primary_key=True),
    Column("schema_version", Integer, nullable=False),
    Column("epoch", Integer, nullable=False),
    Column("head_seq", Integer, nullable=False),
    Column("head_hash", LargeBinary, CheckConstraint("length(head_hash) = 32"), nullable=False),
    sqlite_strict=True,
)

event: Final = Table(
    "event",
    metadata,
    Column("seq", Integer, primary_key=True),
    Column("epoch", Integer, nullable=False),
    Column("booked_ns", BigInteger().with_variant(Integer, "sqlite"), nullable=False),
    Column("kind", Text, nullable=False),
    Column("command_id", Text, nullable=False),
    Column("key", Text),
    Column("body", LargeBinary, nullable=False),
    Column("hash", LargeBinary, CheckConstraint("length(hash) = 32"), nullable=False),
    sqlite_strict=True,
)

idempotency: Final = Table(
    "idempotency",
    metadata,
    Column("key", Text, primary_key=True),
    Column("fingerprint", LargeBinary, nullable=False),
    Column("seq", ForeignKey("event.seq"), unique=True),  # NULL: the book refused the command
    Column("status", Integer, nullable=False),
    Column("reply", LargeBinary, nullable=False),
    Column("digest", LargeBinary, nullable=False),  # of the request that was carried out or refused
    sqlite_strict=True,
)

account: Final = Table(
    "account",
    metadata,
    Column("id", Text, primary_key=True),
    Column("name", Text, nullable=False),
    Column("type", Text, nullable=False),
    Column("currency", Text, nullable=False),
    Column("no_overdraft", Integer, CheckConstraint("no_overdraft IN (0, 1)"), nullable=False),
    Column("posted", BigInteger().with_variant(Integer, "sqlite"), nullable=False),
    Column("closed", Integer, CheckConstraint("closed IN (0, 1)"), nullable=False),
    CheckConstraint(
        "no_overdraft = 0 OR (type IN ('asset', 'expense') AND posted >= 0)"
        " OR (type IN ('liability', 'equity', 'income') AND posted <= 0)",
        name="not_overdrawn",
    ),
    sqlite_strict=True,
)

booking: Final = Table(
    "booking",  # a posted transaction; TRANSACTION is a word of SQL
    metadata,
    Column("id", Text, primary_key=True),
    Column("seq", ForeignKey("event.seq"), nullable=False, unique=True),
    Column("date", Text, nullable=False),
    Column("description", Text, nullable=False),
    Index("booking_by_date", "date", "seq"),
    sqlite_strict=True,
)

posting: Final = Table(
    "posting",
    metadata,
    Column("seq", ForeignKey("event.seq"), primary_key=True),
    Column("line", Integer, primary_key=True),
    Column("account_id", ForeignKey("account.id"), nullable=False),
    Column("amount", BigInteger().with_variant(Integer, "sqlite"), nullable=False),
    Index("posting_by_account", "account_id", "seq"),
    sqlite_strict=True,
    sqlite_with_rowid=False,
)

_TRIGGERS: Final = (
    """CREATE TRIGGER event_is_never_changed BEFORE UPDATE ON event
       BEGIN SELECT RAISE(ABORT, 'an event is never changed'); END""",
    """CREATE TRIGGER event_is_never_deleted BEFORE DELETE ON event
       BEGIN SELECT RAISE(ABORT, 'an event is never deleted'); END""",
    """CREATE TRIGGER event_has_no_gap BEFORE INSERT ON event
       WHEN NEW.seq IS NOT (SELECT coalesce(max(seq), 0) + 1 FROM event)
       BEGIN SELECT RAISE(ABORT, 'events have no gaps'); END""",
    """CREATE TRIGGER event_is_of_this_epoch BEFORE INSERT ON event
       WHEN NEW.epoch IS NOT (SELECT epoch FROM meta)
       BEGIN SELECT RAISE(ABORT, 'an event is written in the epoch of the store'); END""",
    """CREATE TRIGGER epoch_only_grows BEFORE UPDATE ON meta
       WHEN NEW.epoch < OLD.epoch OR NEW.head_seq < OLD.head_seq
       BEGIN SELECT RAISE(ABORT, 'the epoch and the head only grow'); END""",
    """CREATE TRIGGER meta_is_never_deleted BEFORE DELETE ON meta
       BEGIN SELECT RAISE(ABORT, 'the epoch is never deleted'); END""",
    """CREATE TRIGGER key_is_never_changed BEFORE UPDATE ON idempotency
       BEGIN SELECT RAISE(ABORT, 'a key is never changed'); END""",
    """CREATE TRIGGER key_is_never_deleted BEFORE DELETE ON idempotency
       BEGIN SELECT RAISE(ABORT, 'a key is never deleted'); END""",
)


def lay_out(connection: Connection) -> None:
    """Create tables and triggers in the transaction that is open on `connection`."""
    metadata.create_all(connection, checkfirst=False)
    for trigger in _TRIGGERS:
        connection.exec_driver_sql(trigger).close()
