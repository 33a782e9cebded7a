"""The tables: the events are the truth, the others are readings of them made in the same transaction.

STRICT tables and triggers are the second line of defence: no program that opens this file, ours after a bug
included, can change an event, skip a number, write in an old epoch or overdraw an account that may not be.
The readings (accounts, transactions, postings, entries) can be rebuilt from the events; keys can't and are
kept for ever. A version per table was not chosen: one number for the whole is what the fence can check.

A ledger of an older version is taken along, step by step, inside the fence's transaction: the step adds tables
and readings and never touches an event, so a chain that was proven before is the same chain after it.

What *stands* is a posting whose transaction was neither reversed nor is a reversal. Those alone make the
register and the sums of a month; the two halves of a reversal are on the same day and add up to nothing.

What is pending has its own lines: a posting that is none yet must not be found by anything that adds postings up.
A table of postings with a state was not chosen, because every sum in every room would then have to remember it.
"""

from typing import Any, Final

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
    insert,
    select,
    text,
    update,
)
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.schema import CreateColumn

from core.journal import schema_plans
from core.journal.store import is_in_server
from core.journal.stores.triggers import in_plpgsql
from core.ledger.fields import folded

SCHEMA_VERSION: Final = 5
SCHEMA_VERSION_OLDEST: Final = 2  # the oldest one that is taken along
#: In a server there is none older: a step that comes after this one is written for both stores.
SCHEMA_VERSION_OLDEST_IN_SERVER: Final = SCHEMA_VERSION
SCHEMA_VERSION_READABLE: Final = 3  # the oldest one that is read as it stands
SCHEMA_VERSION_ATTESTED: Final = 4  # the first one with attestations

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

_PENDING_DEBIT: Final = (
    "pending_debit >= 0 AND"
    " (no_overdraft = 0 OR type NOT IN ('liability', 'equity', 'income') OR posted <= -pending_debit)"
)
_PENDING_CREDIT: Final = (
    "pending_credit >= 0 AND"
    " (no_overdraft = 0 OR type NOT IN ('asset', 'expense') OR posted >= pending_credit)"
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
    # What is pending is said in rules of its own columns: they can be added to a table that is there.
    Column(
        "pending_debit",
        BigInteger().with_variant(Integer, "sqlite"),
        CheckConstraint(_PENDING_DEBIT),
        nullable=False,
        server_default="0",
    ),
    Column(
        "pending_credit",
        BigInteger().with_variant(Integer, "sqlite"),
        CheckConstraint(_PENDING_CREDIT),
        nullable=False,
        server_default="0",
    ),
    Column("version", Integer, nullable=False, server_default="0"),
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
    Column("date", Text, nullable=False, server_default=""),  # of its booking; a default for the step from 2
    Column("standing", Integer, CheckConstraint("standing IN (0, 1)"), nullable=False, server_default="1"),
    Index("posting_by_account", "account_id", "seq"),
    # Both hold all that a register or a sum asks of a posting, so neither reads the table itself.
    Index("posting_standing", "account_id", "standing", "date", "seq", "line", "amount"),
    Index("posting_by_day", "standing", "date", "seq", "line", "account_id", "amount"),
    sqlite_strict=True,
    sqlite_with_rowid=False,
)

account_name: Final = Table(
    "account_name",  # accounts by name, in the form in which two spellings are equal
    metadata,
    Column("folded", Text, primary_key=True),
    Column("account_id", ForeignKey("account.id"), primary_key=True),
    sqlite_strict=True,
    sqlite_with_rowid=False,
)

entry: Final = Table(
    "entry",  # the newest content of each of the household's entries: where it is booked
    metadata,
    Column("id", Text, primary_key=True),
    Column("seq", ForeignKey("event.seq"), nullable=False, unique=True),
    Column("date", Text, nullable=False),
    Column("account_id", ForeignKey("account.id"), nullable=False),
    Column("category_id", ForeignKey("account.id"), nullable=False),
    Column("reversed", Integer, CheckConstraint("reversed IN (0, 1)"), nullable=False),
    Index("entry_by_date", "date", "seq"),
    Index("entry_by_account", "account_id", "date", "seq"),
    sqlite_strict=True,
)

reversal: Final = Table(
    "reversal",
    metadata,
    Column("seq", ForeignKey("event.seq"), primary_key=True),
    Column("reversed_seq", ForeignKey("event.seq"), nullable=False, unique=True),  # once and never again
    sqlite_strict=True,
)

origin: Final = Table(
    "origin",  # the rows of bank files that were ever booked; what was reversed stays known
    metadata,
    Column("seq", ForeignKey("event.seq"), primary_key=True),
    Column("fingerprint", Text, nullable=False),
    Index("origin_by_fingerprint", "fingerprint"),
    sqlite_strict=True,
)

attestation: Final = Table(
    "attestation",  # in the order of `attestation.Attestation`
    metadata,
    Column("seq", ForeignKey("event.seq"), primary_key=True),
    Column("hash", LargeBinary, CheckConstraint("length(hash) = 32"), nullable=False),
    Column("balances", LargeBinary, CheckConstraint("length(balances) = 32"), nullable=False),
    Column("sums", Text, nullable=False),
    sqlite_strict=True,
)

_IS_OPEN: Final = text("state = 'open'")

pending: Final = Table(
    "pending",  # a transaction that was made pending, and what became of it
    metadata,
    Column("id", Text, primary_key=True),
    Column("seq", ForeignKey("event.seq"), nullable=False, unique=True),
    Column("date", Text, nullable=False),
    Column("description", Text, nullable=False),
    Column(
        "state", Text, CheckConstraint("state IN ('open', 'posted', 'voided', 'expired')"), nullable=False
    ),
    Column("expires_ns", BigInteger().with_variant(Integer, "sqlite")),  # NULL: never
    Column("closed_seq", ForeignKey("event.seq"), unique=True),  # the event that has ended it
    CheckConstraint("(state = 'open') = (closed_seq IS NULL)", name="ended_by_an_event"),
    Index("pending_due", "expires_ns", sqlite_where=_IS_OPEN, postgresql_where=_IS_OPEN),
    sqlite_strict=True,
)

pending_posting: Final = Table(
    "pending_posting",
    metadata,
    Column("seq", ForeignKey("event.seq"), primary_key=True),
    Column("line", Integer, primary_key=True),
    Column("account_id", ForeignKey("account.id"), nullable=False),
    Column("amount", BigInteger().with_variant(Integer, "sqlite"), nullable=False),
    Index("pending_posting_by_account", "account_id", "seq"),
    sqlite_strict=True,
    sqlite_with_rowid=False,
)

assertion: Final = Table(
    "assertion",  # what somebody said an account should stand at, and what it stood at then
    metadata,
    Column("id", Text, primary_key=True),
    Column("seq", ForeignKey("event.seq"), nullable=False, unique=True),
    Column("account_id", ForeignKey("account.id"), nullable=False),
    Column("date", Text, nullable=False),
    Column("amount", BigInteger().with_variant(Integer, "sqlite"), nullable=False),
    Column("actual", BigInteger().with_variant(Integer, "sqlite"), nullable=False),
    Column(
        "holds",
        Integer,
        CheckConstraint("holds IN (0, 1) AND (holds = 1) = (amount = actual)"),
        nullable=False,
    ),
    Index("assertion_by_account", "account_id", "date", "seq"),
    sqlite_strict=True,
)

budget: Final = schema_plans.budget_table(metadata)
recurring: Final = schema_plans.recurring_table(metadata)

_BESIDE_THE_NAME_BYTES: Final = 45  # of a posting: numbers, date, and what SQLite adds

_BESIDE_AN_ACCOUNT_BYTES: Final = 600  # of its row in log and file, and its part of a few pages

_TABLES_OF_VERSION_5: Final = (pending, pending_posting, assertion, budget, recurring)
_COLUMNS_OF_VERSION_5: Final = (
    f"pending_debit INTEGER NOT NULL DEFAULT '0' CHECK ({_PENDING_DEBIT})",
    f"pending_credit INTEGER NOT NULL DEFAULT '0' CHECK ({_PENDING_CREDIT})",
    "version INTEGER NOT NULL DEFAULT '0'",
)

_TABLES_OF_VERSION_3: Final = (account_name, entry, reversal, origin)
_INDEXES_OF_VERSION_3: Final = frozenset({"posting_standing", "posting_by_day"})

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

_TRIGGERS_OF_VERSION_3: Final = (
    """CREATE TRIGGER reversal_is_never_changed BEFORE UPDATE ON reversal
       BEGIN SELECT RAISE(ABORT, 'a reversal is never changed'); END""",
    """CREATE TRIGGER reversal_is_never_deleted BEFORE DELETE ON reversal
       BEGIN SELECT RAISE(ABORT, 'a reversal is never deleted'); END""",
    """CREATE TRIGGER origin_is_never_changed BEFORE UPDATE ON origin
       BEGIN SELECT RAISE(ABORT, 'a known row is never changed'); END""",
    """CREATE TRIGGER origin_is_never_deleted BEFORE DELETE ON origin
       BEGIN SELECT RAISE(ABORT, 'a known row is never forgotten'); END""",
)

_TRIGGERS_OF_VERSION_4: Final = (
    """CREATE TRIGGER attestation_is_never_changed BEFORE UPDATE ON attestation
       BEGIN SELECT RAISE(ABORT, 'an attestation is never changed'); END""",
    """CREATE TRIGGER attestation_is_never_deleted BEFORE DELETE ON attestation
       BEGIN SELECT RAISE(ABORT, 'an attestation is never deleted'); END""",
    """CREATE TRIGGER attestation_is_of_its_event BEFORE INSERT ON attestation
       WHEN NEW.hash IS NOT (SELECT hash FROM event WHERE seq = NEW.seq)
       BEGIN SELECT RAISE(ABORT, 'an attestation is of the event that is there'); END""",
)

_TRIGGERS_OF_VERSION_5: Final = (
    """CREATE TRIGGER pending_ends_once BEFORE UPDATE ON pending
       WHEN OLD.state <> 'open' OR NEW.state = 'open' OR NEW.id IS NOT OLD.id OR NEW.seq IS NOT OLD.seq
         OR NEW.date IS NOT OLD.date OR NEW.description IS NOT OLD.description
         OR NEW.expires_ns IS NOT OLD.expires_ns
       BEGIN SELECT RAISE(ABORT, 'what is pending ends once, and is never changed'); END""",
    """CREATE TRIGGER pending_is_never_deleted BEFORE DELETE ON pending
       BEGIN SELECT RAISE(ABORT, 'what was pending is never deleted'); END""",
    """CREATE TRIGGER pending_posting_is_never_changed BEFORE UPDATE ON pending_posting
       BEGIN SELECT RAISE(ABORT, 'what was pending is never changed'); END""",
    """CREATE TRIGGER pending_posting_is_never_deleted BEFORE DELETE ON pending_posting
       BEGIN SELECT RAISE(ABORT, 'what was pending is never deleted'); END""",
    """CREATE TRIGGER assertion_is_never_changed BEFORE UPDATE ON assertion
       BEGIN SELECT RAISE(ABORT, 'an assertion is never changed'); END""",
    """CREATE TRIGGER assertion_is_never_deleted BEFORE DELETE ON assertion
       BEGIN SELECT RAISE(ABORT, 'an assertion is never deleted'); END""",
    *schema_plans.TRIGGERS,
)


def _count_alike() -> None:
    """Give whole numbers the type that has 64 bits in either store: INTEGER in a file, BIGINT in a server."""
    whole = BigInteger().with_variant(Integer(), "sqlite")
    for table in metadata.sorted_tables:
        for column in table.columns:
            if isinstance(column.type, Integer):
                column.type = whole
                column.autoincrement = False


@compiles(CreateColumn, "postgresql")
def _order_alike(made: CreateColumn, compiler: Any, **named: Any) -> str:
    """Order texts by their bytes, as a file does: a cursor that goes by names would go astray in another order.

    It stands in the table and not in the type, which would say it of every value that is compared with it too.
    """
    column: str = compiler.visit_create_column(made, **named)
    if not isinstance(made.element.type, Text):
        return column
    return column.replace(" TEXT", ' TEXT COLLATE "C"', 1)


_count_alike()


def oldest_of(connection: Connection) -> int:
    """Return the oldest version that is taken along from this store."""
    return SCHEMA_VERSION_OLDEST_IN_SERVER if is_in_server(connection) else SCHEMA_VERSION_OLDEST


def lay_out(connection: Connection) -> None:
    """Create tables and triggers in the transaction that is open on `connection`."""
    metadata.create_all(connection, checkfirst=False)
    lay_triggers(connection)


def lay_triggers(connection: Connection) -> None:
    """Create the triggers of all tables, which are there."""
    rules = (*_TRIGGERS, *_TRIGGERS_OF_VERSION_3, *_TRIGGERS_OF_VERSION_4, *_TRIGGERS_OF_VERSION_5)
    for statement in in_plpgsql(rules) if is_in_server(connection) else rules:
        connection.exec_driver_sql(statement).close()


def bring_up(connection: Connection, version: int) -> None:
    """Bring a ledger of an older version to this one, in the transaction that is open on `connection`."""
    assert SCHEMA_VERSION_OLDEST <= version < SCHEMA_VERSION
    if version < 3:
        _from_2_to_3(connection)
    if version < 4:
        _from_3_to_4(connection)
    _from_4_to_5(connection)
    connection.execute(update(meta).values(schema_version=SCHEMA_VERSION))


def bring_up_bytes(connection: Connection, version: int) -> int:
    """Return how much room `bring_up` needs beside the ledger, in its log and in its file together.

    The step from 2 writes every posting anew and lays two indexes over them in one transaction: three times a line into
    the log, and two of them are new in the file (for 400,000 of them 79 MB, where this says 112). The one from 3
    writes a few pages, the one from 4 every account.
    """
    accounts = connection.exec_driver_sql("SELECT count(*) FROM account").scalar_one()
    room = _BESIDE_AN_ACCOUNT_BYTES * int(accounts)
    if version >= 3:
        return room
    lines, name_bytes = connection.exec_driver_sql(
        "SELECT count(*), coalesce(sum(length(CAST(account_id AS BLOB))), 0) FROM posting"
    ).one()
    return room + 5 * (int(name_bytes) + _BESIDE_THE_NAME_BYTES * int(lines))


def views_over(version: int) -> tuple[str, ...]:
    """Return what has a ledger of an older version read as one of this version, on a connection that only reads.

    Views of that connection alone stand before its tables: nothing was ever pending there, and nothing asserted.
    """
    if version >= SCHEMA_VERSION:
        return ()
    empty = (
        (table.name, ", ".join(f"NULL AS {column.name}" for column in table.columns))
        for table in _TABLES_OF_VERSION_5
    )
    accounts = (
        "CREATE TEMP VIEW account AS SELECT a.*, 0 AS pending_debit, 0 AS pending_credit, 1 + a.closed +"
        " (SELECT count(DISTINCT seq) FROM main.posting WHERE account_id = a.id) AS version"
        " FROM main.account AS a"
    )
    return (
        "PRAGMA temp_store = MEMORY",
        accounts,
        *(f"CREATE TEMP VIEW {name} AS SELECT {columns} WHERE 0" for name, columns in empty),
    )


def _from_2_to_3(connection: Connection) -> None:
    for change in (
        "ALTER TABLE posting ADD COLUMN date TEXT NOT NULL DEFAULT ''",
        "ALTER TABLE posting ADD COLUMN standing INTEGER NOT NULL DEFAULT '1' CHECK (standing IN (0, 1))",
        "UPDATE posting SET date = (SELECT date FROM booking WHERE booking.seq = posting.seq)",
    ):
        connection.exec_driver_sql(change).close()
    metadata.create_all(connection, tables=_TABLES_OF_VERSION_3, checkfirst=False)
    for index in posting.indexes:
        if index.name in _INDEXES_OF_VERSION_3:
            index.create(connection)
    for trigger in _TRIGGERS_OF_VERSION_3:
        connection.exec_driver_sql(trigger).close()
    names = [
        {"folded": folded(row.name), "account_id": row.id}
        for row in connection.execute(select(account.c.id, account.c.name))
    ]
    if names:
        connection.execute(insert(account_name), names)


def _from_3_to_4(connection: Connection) -> None:
    # What was booked before is not attested now: nobody has looked at it. The whole replay does so.
    attestation.create(connection)
    for trigger in _TRIGGERS_OF_VERSION_4:
        connection.exec_driver_sql(trigger).close()


def _from_4_to_5(connection: Connection) -> None:
    for column in _COLUMNS_OF_VERSION_5:
        connection.exec_driver_sql(f"ALTER TABLE account ADD COLUMN {column}").close()
    # Its opening, its end if it has one, and every transaction with a line on it.
    connection.exec_driver_sql(
        "UPDATE account SET version = 1 + closed"
        " + (SELECT count(DISTINCT seq) FROM posting WHERE account_id = account.id)"
    ).close()
    metadata.create_all(connection, tables=_TABLES_OF_VERSION_5, checkfirst=False)
    for trigger in _TRIGGERS_OF_VERSION_5:
        connection.exec_driver_sql(trigger).close()
