"""Laying down: the rows of a batch, table by table, in the order in which one needs the other.

Statements are made once, and each is carried out once for all rows of its kind. Nothing is decided here and nothing is
read: what is to be written stands in the batch, and the transaction is the journal's. Each statement is put into the
store's words once (by SQLAlchemy, as ever) and the rows are handed over as the driver takes them: to look at every value of
every row on its way there cost a fifth of a batch, and no value needs it.
"""

from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import Any, Final
from weakref import WeakKeyDictionary

import msgspec
from sqlalchemy import Connection, Insert, Update, bindparam, insert, literal_column, update
from sqlalchemy.engine import Dialect
from sqlalchemy.sql.compiler import SQLCompiler

from core.journal import schema
from core.journal.batch import Batch, Row
from core.ledger.accounts import Account
from core.ledger.book import KnownEntry
from core.ledger.fields import folded


def lay_down(connection: Connection, batch: Batch) -> None:
    """Write the rows of a batch, all but its head, in the transaction that is open on `connection`."""
    book = batch.book
    for statement, rows in (
        (_EVENTS, batch.events),
        (_KEYS, batch.key_rows),
        (_OPEN, [_account_row(book.accounts[name]) for name in sorted(batch.opened)]),
        (_NAME, [_name_row(book.accounts[name]) for name in sorted(batch.opened)]),
        (_CHANGE, [_change_row(book.accounts[name]) for name in sorted(batch.changed - batch.opened)]),
        (_BOOKINGS, batch.bookings),
        (_POSTINGS, batch.postings),
        (_REVERSALS, batch.reversals),
        # After the postings: what stands no longer may have been booked in this very batch.
        (_FALL, [{"reversed_seq": seq} for seq in batch.reversed_seqs]),
        (_ENTER, [_entry_row(book.entries[name]) for name in sorted(batch.entered)]),
        (_ALTER, [_altered_row(book.entries[name]) for name in sorted(batch.altered - batch.entered)]),
        (_ORIGINS, batch.origins),
        (_PENDINGS, batch.pendings),
        (_PENDING_POSTINGS, batch.pending_postings),
        # After them: what ends may have been made pending in this very batch.
        (_END, batch.endings),
        (_ASSERTIONS, batch.assertions),
        (_BUDGETS, batch.budgets),
        (_RECURRINGS, batch.recurrings),
    ):
        if rows:
            worded = _worded(connection.dialect, statement, rows[0])
            said = rows if worded.pick is None else list(map(worded.pick, rows))
            connection.exec_driver_sql(worded.text, said).close()


class _Worded(msgspec.Struct, frozen=True):
    """A statement in a store's words. `pick` takes the values out of a row in their order; None: they go by name."""

    text: str
    pick: Callable[[Row], tuple[Any, ...]] | None


def _worded(dialect: Dialect, statement: Insert | Update, row: Row) -> _Worded:
    """Return a statement in the words of this store. All rows that it is ever given name the same columns."""
    kept = _WORDED.setdefault(dialect, {})
    if statement not in kept:
        made = statement.compile(dialect=dialect, column_keys=list(row), for_executemany=True)
        assert isinstance(made, SQLCompiler)
        assert made.params.keys() <= row.keys(), "what a statement says stands in the row or in its words"
        kept[statement] = _Worded(made.string, _picking(made.positiontup))
    return kept[statement]


def _picking(names: Sequence[str] | None) -> Callable[[Row], tuple[Any, ...]] | None:
    match names:
        case None:
            return None
        case [name]:
            return lambda row: (row[name],)
        case _:
            return itemgetter(*names)


def _account_row(account: Account) -> dict[str, Any]:
    return {
        "id": account.id,
        "name": account.name,
        "type": account.type.value,
        "currency": account.currency,
        "no_overdraft": int(account.no_overdraft),
        "posted": account.posted,
        "closed": int(account.closed),
        "pending_debit": account.pending_debit,
        "pending_credit": account.pending_credit,
        "version": account.version,
    }


def _name_row(account: Account) -> dict[str, Any]:
    return {"folded": folded(account.name), "account_id": account.id}


def _entry_row(known: KnownEntry) -> dict[str, Any]:
    money, category = known.event.postings
    return {
        "id": known.event.entry,
        "seq": known.seq,
        "date": known.event.date,
        "account_id": money.account,
        "category_id": category.account,
        "reversed": int(known.reversed),
    }


def _altered_row(known: KnownEntry) -> dict[str, Any]:
    return {f"new_{name}": value for name, value in _entry_row(known).items()}


def _change_row(account: Account) -> dict[str, Any]:
    return {
        "which": account.id,
        "new_posted": account.posted,
        "new_closed": int(account.closed),
        "new_pending_debit": account.pending_debit,
        "new_pending_credit": account.pending_credit,
        "new_version": account.version,
    }


#: By the store's dialect, which lives as long as its engine does.
_WORDED: Final[WeakKeyDictionary[Dialect, dict[Insert | Update, _Worded]]] = WeakKeyDictionary()

_EVENTS: Final = insert(schema.event)
_KEYS: Final = insert(schema.idempotency)
_BOOKINGS: Final = insert(schema.booking)
_POSTINGS: Final = insert(schema.posting)
_OPEN: Final = insert(schema.account)
_NAME: Final = insert(schema.account_name)
_REVERSALS: Final = insert(schema.reversal)
_FALL: Final = (
    update(schema.posting)
    .where(schema.posting.c.seq == bindparam("reversed_seq"))
    .values(standing=literal_column("0"))
)
_ENTER: Final = insert(schema.entry)
_ALTER: Final = (
    update(schema.entry)
    .where(schema.entry.c.id == bindparam("new_id"))
    .values(
        seq=bindparam("new_seq"),
        date=bindparam("new_date"),
        account_id=bindparam("new_account_id"),
        category_id=bindparam("new_category_id"),
        reversed=bindparam("new_reversed"),
    )
)
_ORIGINS: Final = insert(schema.origin)
_PENDINGS: Final = insert(schema.pending)
_PENDING_POSTINGS: Final = insert(schema.pending_posting)
_END: Final = (
    update(schema.pending)
    .where(schema.pending.c.id == bindparam("which"))
    .values(state=bindparam("new_state"), closed_seq=bindparam("new_closed_seq"))
)
_ASSERTIONS: Final = insert(schema.assertion)
_BUDGETS: Final = insert(schema.budget)
_RECURRINGS: Final = insert(schema.recurring)
_CHANGE: Final = (
    update(schema.account)
    .where(schema.account.c.id == bindparam("which"))
    .values(
        posted=bindparam("new_posted"),
        closed=bindparam("new_closed"),
        pending_debit=bindparam("new_pending_debit"),
        pending_credit=bindparam("new_pending_credit"),
        version=bindparam("new_version"),
    )
)
