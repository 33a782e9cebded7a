"""What people are told of plans: what was taken, what comes back when, and what became of it.

Pure: the rows were read and the day is given. What is upcoming begins tomorrow: today's is being booked while somebody
looks, and is told by what became of it.
"""

import datetime as dt
from itertools import islice
from typing import Final

import msgspec

from core.ledger.moments import timestamp
from core.ledger.planning import days_of
from core.ledger.plans import (
    BudgetSet,
    EntryTemplate,
    KnownRecurring,
    PlanEvent,
    RecurringEnded,
    TransactionTemplate,
)
from core.ledger.recurrence import Rule
from core.ledger.views import Place

UPCOMING_MAX: Final = 12
UPCOMING_DAYS: Final = 366


class PlanAnswer(msgspec.Struct, frozen=True):
    """The answer to a plan that was taken: its event, and what was said (`id` of a recurring item, or the account)."""

    id: str
    seq: int
    epoch: int
    hash: str
    booked_at: str
    ended: bool
    month: str | None
    amount: str | None
    currency: str | None


class RecurringBooking(msgspec.Struct, frozen=True):
    """What became of a recurring item on one of its days: `booked` (`id`: of what), or `refused` (`slug`: why)."""

    date: str
    outcome: str
    id: str | None
    slug: str | None


class RecurringView(msgspec.Struct, frozen=True):
    """A recurring item: what it is now, when it comes next, and what became of its last days, newest first."""

    id: str
    seq: int
    title: str
    rule: Rule
    start: str
    end: str | None
    entry: EntryTemplate | None
    transaction: TransactionTemplate | None
    since: str
    ended: bool
    upcoming: tuple[str, ...]
    bookings: tuple[RecurringBooking, ...] = ()


def answer_plan(event: PlanEvent, place: Place) -> PlanAnswer:
    """Return the answer to a plan that was taken."""
    budget = event if isinstance(event, BudgetSet) else None
    return PlanAnswer(
        id=event.account if isinstance(event, BudgetSet) else event.id,
        seq=place.seq,
        epoch=place.epoch,
        hash=place.hash.hex(),
        booked_at=timestamp(place.booked_ns),
        ended=isinstance(event, RecurringEnded),
        month=budget.month if budget else None,
        amount=budget.amount if budget else None,
        currency=budget.currency if budget else None,
    )


def view_recurring(
    known: KnownRecurring, today: dt.date, bookings: tuple[RecurringBooking, ...] = ()
) -> RecurringView:
    """Return a recurring item as answers show it; what is upcoming comes after `today`."""
    event = known.event
    last = min(today.toordinal() + UPCOMING_DAYS, dt.date.max.toordinal())
    first = dt.date.fromordinal(min(today.toordinal() + 1, dt.date.max.toordinal()))
    coming = () if known.ended else days_of(event, first, dt.date.fromordinal(last))
    return RecurringView(
        id=event.id,
        seq=known.seq,
        title=event.plan.title,
        rule=event.plan.rule,
        start=event.plan.start,
        end=event.plan.end,
        entry=event.plan.entry,
        transaction=event.plan.transaction,
        since=event.since,
        ended=known.ended,
        upcoming=tuple(day.isoformat() for day in islice(coming, UPCOMING_MAX)),
        bookings=bookings,
    )
