"""Reading plans: what is meant in a month, what comes back, and what became of it.

What counts is the newest line said for a month or one before it, so one look at an index finds it for every category at
once. What became of a recurring item on its days is not stored anywhere beside: it was booked under a key that names the
item and the day, and what the book keeps under that key is the answer, the reason of a refusal included.
"""

import datetime as dt
from collections.abc import Container, Iterable
from itertools import islice
from typing import Any, Final

import msgspec
from sqlalchemy import Connection, func, select

from core.journal import schema
from core.journal.shelf import account_of, recurring_of
from core.journal.sums import halves, whole
from core.ledger.budgets import BudgetLine, view_budget
from core.ledger.fields import is_date
from core.ledger.overview import category_name
from core.ledger.plan_views import RecurringBooking, RecurringView, view_recurring
from core.ledger.planning import days_of, key_of
from core.ledger.plans import KnownRecurring
from core.ledger.reasons import Rejection

BOOKINGS_SHOWN: Final = 50
LOOKED_BACK_DAYS: Final = 400
_PART: Final = 500


class _Booked(msgspec.Struct, frozen=True):
    """Of a kept answer: what was booked."""

    id: str = ""


def budgets_of(connection: Connection, month: str, first_day: str, last_day: str) -> tuple[BudgetLine, ...]:
    """Return what is meant in a month and what was moved in it, by category; what is meant no more is left out."""
    said, account, posting = schema.budget.c, schema.account.c, schema.posting.c
    newest = func.row_number().over(
        partition_by=said.account_id, order_by=(said.month.desc(), said.seq.desc())
    )
    ranked = (
        select(said.account_id, said.month, said.amount, newest.label("place"))
        .where(said.month <= month)
        .subquery()
    )
    meant = connection.execute(
        select(schema.account, ranked.c.month, ranked.c.amount)
        .join(ranked, ranked.c.account_id == account.id)
        .where(ranked.c.place == 1, ranked.c.amount.is_not(None))
        .order_by(account.id)
    ).all()
    if not meant:
        return ()
    moved = {
        row.account_id: whole(row)
        for row in connection.execute(
            select(posting.account_id, *halves(posting.amount))
            .where(
                posting.standing == 1,
                posting.account_id.in_(select(said.account_id)),
                posting.date.between(first_day, last_day),
            )
            .group_by(posting.account_id)
        )
    }
    return tuple(_line(row, moved.get(row.id, 0)) for row in meant)


def list_recurring(
    connection: Connection, after: str | None, limit: int, today: dt.date, parked: Container[int]
) -> list[RecurringView]:
    """Return the recurring items that have not ended, by id (the oldest first), beginning after one of them."""
    found = islice(_items(connection, after, parked), limit)
    return [view_recurring(known, today) for known in found]


def get_recurring(
    connection: Connection, item_id: str, today: dt.date, parked: Container[int]
) -> RecurringView | None:
    """Return a recurring item with what became of its last days, also of one that has ended."""
    known = recurring_of(connection, item_id, parked)
    return view_recurring(known, today, _bookings(connection, item_id)) if known is not None else None


def going_on(connection: Connection, parked: Container[int]) -> list[KnownRecurring]:
    """Return every recurring item that has not ended."""
    return list(_items(connection, None, parked))


def unbooked(connection: Connection, known: KnownRecurring, today: dt.date, most: int) -> list[str]:
    """Return days of a recurring item up to today that nothing is kept of, the oldest first, at most so many.

    Days are booked in their order, so nothing is looked for more than a year before the newest one that is kept: else
    every look at an old item would ask for all the days it ever had.
    """
    if most <= 0:
        return []
    newest = _newest_kept(connection, known.event.id)
    first = dt.date.fromordinal(max(1, newest.toordinal() - LOOKED_BACK_DAYS)) if newest else dt.date.min
    found: list[str] = []
    kept = schema.idempotency.c.key
    days = (day.isoformat() for day in days_of(known.event, first, today))
    while part := list(islice(days, _PART)):
        keys = {key_of(known.event.id, day): day for day in part}
        seen = set(connection.execute(select(kept).where(kept.in_(list(keys)))).scalars())
        found.extend(day for key, day in keys.items() if key not in seen)
        if len(found) >= most:
            break
    return found[:most]


def _newest_kept(connection: Connection, item_id: str) -> dt.date | None:
    newest = _bookings(connection, item_id, 1)
    return dt.date.fromisoformat(newest[0].date) if newest and is_date(newest[0].date) else None


def _items(connection: Connection, after: str | None, parked: Container[int]) -> Iterable[KnownRecurring]:
    recurring = schema.recurring.c
    ended = select(recurring.id).where(recurring.ended == 1)
    query = select(recurring.id).distinct().where(recurring.id.not_in(ended)).order_by(recurring.id)
    if after is not None:
        query = query.where(recurring.id > after)
    for item_id in connection.execute(query).scalars().all():
        known = recurring_of(connection, item_id, parked)
        if known is not None:
            yield known


def _bookings(
    connection: Connection, item_id: str, most: int = BOOKINGS_SHOWN
) -> tuple[RecurringBooking, ...]:
    kept = schema.idempotency.c
    prefix = key_of(item_id, "")
    query = (
        select(kept.key, kept.seq, kept.reply)
        .where(kept.key >= prefix, kept.key < prefix + "~")  # days are digits, which stand before it
        .order_by(kept.key.desc())
        .limit(most)
    )
    return tuple(_booking(row, row.key.removeprefix(prefix)) for row in connection.execute(query))


def _booking(row: Any, day: str) -> RecurringBooking:
    if row.seq is None:
        refused = msgspec.json.decode(row.reply, type=Rejection)
        return RecurringBooking(day, "refused", None, refused.slug.value)
    return RecurringBooking(day, "booked", msgspec.json.decode(row.reply, type=_Booked).id, None)


def _line(row: Any, moved: int) -> BudgetLine:
    account = account_of(row)
    return view_budget(account, category_name(account), row.amount, row.month, moved)
