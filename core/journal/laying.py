"""Laying down: the rows of a batch, table by table, in the order in which one needs the other.

Statements are made once, and each is carried out once for all rows of its kind. Nothing is decided here and nothing is
read: what is to be written stands in the batch, and the transaction is the journal's.
"""

from typing import Any, Final

from sqlalchemy import Connection, bindparam, insert, update

from core.journal import schema
from core.journal.batch import Batch
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
            connection.execute(statement, rows)


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


_EVENTS: Final = insert(schema.event)
_KEYS: Final = insert(schema.idempotency)
_BOOKINGS: Final = insert(schema.booking)
_POSTINGS: Final = insert(schema.posting)
_OPEN: Final = insert(schema.account)
_NAME: Final = insert(schema.account_name)
_REVERSALS: Final = insert(schema.reversal)
_FALL: Final = (
    update(schema.posting).where(schema.posting.c.seq == bindparam("reversed_seq")).values(standing=0)
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
