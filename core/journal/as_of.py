"""The book by its days: what stood on accounts by the end of a day, and what somebody has asserted of that.

The day of a posting is that of its transaction and not the one on which it was written down, so what was entered late is
counted where it belongs. Both halves of a reversal are on the same day and add up to nothing, so only what stands is added
up. What is pending is on no day yet and is no part of these balances.
"""

from typing import Any

import msgspec
from sqlalchemy import Connection, select

from core.journal import schema
from core.journal.queries import get_account, list_accounts
from core.journal.shelf import stood_at
from core.journal.sums import halves, whole
from core.ledger.accounts import Account
from core.ledger.moments import timestamp
from core.ledger.money import format_amount
from core.ledger.views import AssertionView, Place


def accounts_as_of(connection: Connection, day: str, after: str | None, limit: int) -> list[Account]:
    """Return accounts by id as they stood by the end of a day, beginning after one of them."""
    accounts = list_accounts(connection, after, limit)
    posting = schema.posting.c
    if not accounts:
        return []
    query = (
        select(posting.account_id, *halves(posting.amount))
        .where(
            posting.standing == 1,
            posting.account_id.between(accounts[0].id, accounts[-1].id),
            posting.date <= day,
        )
        .group_by(posting.account_id)
    )
    stood = {row.account_id: whole(row) for row in connection.execute(query)}
    return [_as_of(account, stood.get(account.id, 0)) for account in accounts]


def account_as_of(connection: Connection, account_id: str, day: str) -> Account | None:
    """Return one account as it stood by the end of a day."""
    account = get_account(connection, account_id)
    return _as_of(account, stood_at(connection, account_id, day)) if account is not None else None


def list_assertions(
    connection: Connection, account_id: str, before_seq: int | None, limit: int
) -> list[AssertionView]:
    """Return what was asserted of an account, newest first, each with what the book knew then."""
    asserted, event = schema.assertion.c, schema.event.c
    query = (
        select(
            schema.assertion,
            schema.account.c.currency,
            event.epoch,
            event.booked_ns,
            event.hash,
        )
        .join(schema.event, event.seq == asserted.seq)
        .join(schema.account, schema.account.c.id == asserted.account_id)
        .where(asserted.account_id == account_id)
        .order_by(asserted.seq.desc())
        .limit(limit)
    )
    if before_seq is not None:
        query = query.where(asserted.seq < before_seq)
    return [_assertion(row) for row in connection.execute(query)]


def _as_of(account: Account, posted: int) -> Account:
    return msgspec.structs.replace(account, posted=posted, pending_debit=0, pending_credit=0)


def _assertion(row: Any) -> AssertionView:
    place = Place(row.seq, row.epoch, row.booked_ns, row.hash)
    return AssertionView(
        id=row.id,
        seq=place.seq,
        epoch=place.epoch,
        hash=place.hash.hex(),
        booked_at=timestamp(place.booked_ns),
        account=row.account_id,
        date=row.date,
        amount=format_amount(row.amount, row.currency),
        currency=row.currency,
        actual=format_amount(row.actual, row.currency),
        off_by=format_amount(row.amount - row.actual, row.currency),
        holds=bool(row.holds),
    )
