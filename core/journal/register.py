"""Reading the household's side of the book: its entries, the register with balances, a month in sums.

Lists go backwards by day, and a page goes on after the place it ended at (day, number, line), so it never
shifts under new bookings. Balances are not stored: the one of a page's newest line is the account's balance
less what stands after it, and every older one follows from it. That reads one index and little of it for the
pages people look at; a balance in each row was not chosen, because an entry for last month would rewrite all
rows since. Sums are added in two halves: SQL's own would overflow at 64 bits. What is left out of every rebuild (`parked`)
is drawn from the readings alone (`drawing`).
"""

from collections.abc import Container, Sequence
from typing import Any, Final

import msgspec
from sqlalchemy import ColumnElement, Connection, and_, func, or_, select, tuple_, union_all

from core.journal import schema
from core.journal.drawing import booking_of
from core.journal.planned import budgets_of
from core.journal.shelf import account_of
from core.journal.sums import halves, whole
from core.ledger.accounts import AccountType
from core.ledger.course import Course, Moved, courses
from core.ledger.events import Booking, EntryPosted
from core.ledger.household import CATEGORY_TYPES, MONEY_TYPES
from core.ledger.money import amount_fault, parse_amount
from core.ledger.overview import (
    CategoryView,
    RegisterLine,
    StandingLine,
    Summary,
    summarise,
    view_category,
    view_line,
)
from core.ledger.views import EntryView, Place, view_entry

ACCOUNTS_MAX: Final = 10_000


class Position(msgspec.Struct, frozen=True):
    """A place in a list that goes by days; `line` is 0 in a list of entries."""

    date: str
    seq: int
    line: int = 0


class HouseholdFilter(msgspec.Struct, frozen=True):
    """Which entries or lines: of an account, between two days (inclusive), with words or an amount."""

    account: str | None = None
    date_from: str | None = None
    date_to: str | None = None
    words: str | None = None
    after: Position | None = None
    limit: int = 50


def get_entry(connection: Connection, entry_id: str, parked: Container[int]) -> EntryView | None:
    """Return the newest content of an entry; None if there is none or it was reversed."""
    query = _entries_query().where(schema.entry.c.id == entry_id)
    row = connection.execute(query).one_or_none()
    return _entry(connection, row, parked) if row else None


def list_entries(connection: Connection, wanted: HouseholdFilter, parked: Container[int]) -> list[EntryView]:
    """Return what stands of the entries, newest day first."""
    entry = schema.entry.c
    query = _entries_query().order_by(entry.date.desc(), entry.seq.desc()).limit(wanted.limit)
    if wanted.account is not None:
        query = query.where(or_(entry.account_id == wanted.account, entry.category_id == wanted.account))
    query = _within(query, entry.date, wanted)
    if wanted.words is not None:
        money = schema.posting.c
        query = query.join(schema.posting, and_(money.seq == entry.seq, money.line == 0))
        query = query.where(_matches(connection, wanted.words))
    if wanted.after is not None:
        here = (wanted.after.date, wanted.after.seq)
        query = query.where(tuple_(entry.date, entry.seq) < here)
    return [_entry(connection, row, parked) for row in connection.execute(query)]


def list_register(
    connection: Connection, wanted: HouseholdFilter, parked: Container[int]
) -> list[RegisterLine]:
    """Return what stands on an account (None: on all accounts of money), newest day first, with balances."""
    posting = schema.posting.c
    query = _LINES.order_by(posting.date.desc(), posting.seq.desc(), posting.line.desc()).limit(wanted.limit)
    if wanted.account is not None:
        query = query.where(posting.account_id == wanted.account)
    else:
        query = query.where(schema.account.c.type.in_([kind.value for kind in MONEY_TYPES]))
    query = _within(query, posting.date, wanted)
    if wanted.words is not None:
        query = query.where(_matches(connection, wanted.words))
    if wanted.after is not None:
        query = query.where(_place() < (wanted.after.date, wanted.after.seq, wanted.after.line))
    rows = connection.execute(query).all()
    balances = _balances(connection, rows, has_gaps=wanted.words is not None)
    events = _bookings(connection, [row.seq for row in rows], parked)
    return [
        view_line(StandingLine(row.seq, row.line, events[row.seq], account_of(row), row.amount, balance))
        for row, balance in zip(rows, balances, strict=True)
    ]


def summary_of(connection: Connection, month: str, first_day: str, last_day: str) -> Summary:
    """Return a month in sums; its first and last day are given, because only the caller knows a calendar."""
    posting, account = schema.posting.c, schema.account.c
    # No limit where sums are made: an account that is left out would make them wrong without a word.
    of_categories = select(account.id).where(account.type.in_([kind.value for kind in CATEGORY_TYPES]))
    sums = (
        select(posting.account_id, *_HALVES)
        .where(_STANDS, posting.account_id.in_(of_categories), posting.date.between(first_day, last_day))
        .group_by(posting.account_id)
        .subquery()
    )
    categories = select(schema.account, sums.c.high, sums.c.low).join(sums, sums.c.account_id == account.id)
    moved = [(account_of(row), whole(row)) for row in connection.execute(categories)]
    of_money = account.type.in_([kind.value for kind in MONEY_TYPES])
    money = select(schema.account).where(of_money, account.closed == 0).order_by(account.id)
    return summarise(
        month,
        _worth(connection),
        [account_of(row) for row in connection.execute(money.limit(ACCOUNTS_MAX))],
        [(category, amount) for category, amount in moved if amount],
        budgets_of(connection, month, first_day, last_day),
    )


def courses_of(connection: Connection, months: Sequence[str]) -> tuple[Course, ...]:
    """Return the course of these months (YYYY-MM, in their order), by currency."""
    posting, account = schema.posting.c, schema.account.c
    month = func.substr(posting.date, 1, len("YYYY-MM")).label("month")
    told = [kind.value for kind in (*MONEY_TYPES, *CATEGORY_TYPES)]
    sums = (
        select(month, account.type, account.currency, *_HALVES)
        .select_from(schema.posting)
        .join(schema.account, account.id == posting.account_id)
        .where(_STANDS, posting.date >= f"{months[0]}-01", account.type.in_(told))
        .group_by(month, account.type, account.currency)
    )
    moved = [
        Moved(row.month, AccountType(row.type), row.currency, whole(row)) for row in connection.execute(sums)
    ]
    return courses(months, _worth(connection), moved)


def list_categories(connection: Connection, after: str | None, limit: int) -> list[CategoryView]:
    """Return the open categories by id, beginning after one of them."""
    posting = schema.posting.c
    last_used = (
        select(func.max(posting.date))
        .where(_STANDS, posting.account_id == schema.account.c.id)
        .scalar_subquery()
    )
    query = (
        select(schema.account, last_used.label("last_used"))
        .where(
            schema.account.c.type.in_([kind.value for kind in CATEGORY_TYPES]), schema.account.c.closed == 0
        )
        .order_by(schema.account.c.id)
        .limit(limit)
    )
    if after is not None:
        query = query.where(schema.account.c.id > after)
    return [view_category(account_of(row), row.last_used) for row in connection.execute(query)]


def _worth(connection: Connection) -> dict[str, int]:
    """Return what is owned now less what is owed, by currency."""
    account = schema.account.c
    of_money = account.type.in_([kind.value for kind in MONEY_TYPES])
    worth = select(account.currency, *halves(account.posted)).where(of_money).group_by(account.currency)
    return {row.currency: whole(row) for row in connection.execute(worth)}


def _balances(connection: Connection, rows: Sequence[Any], *, has_gaps: bool) -> list[int]:
    """Return the balance of its account after each of these lines, which go from new to old."""
    balances: list[int] = []
    newer: dict[str, tuple[Any, int]] = {}
    for row in rows:
        before = newer.get(row.id)
        if before is None:
            balance = row.posted - _between(connection, row, None)
        elif has_gaps:
            balance = before[1] - _between(connection, row, before[0])
        else:
            balance = before[1] - before[0].amount
        newer[row.id] = (row, balance)
        balances.append(balance)
    return balances


def _between(connection: Connection, after: Any, until: Any | None) -> int:
    """Return what stands on an account after one line up to and with another (None: up to the last one)."""
    posting = schema.posting.c
    query = select(*_HALVES).where(_STANDS, posting.account_id == after.id)
    query = query.where(_place() > (after.date, after.seq, after.line))
    if until is not None:
        query = query.where(_place() <= (until.date, until.seq, until.line))
    return whole(connection.execute(query).one())


def _place() -> Any:
    posting = schema.posting.c
    return tuple_(posting.date, posting.seq, posting.line)


def _within(query: Any, date: Any, wanted: HouseholdFilter) -> Any:
    if wanted.date_from is not None:
        query = query.where(date >= wanted.date_from)
    if wanted.date_to is not None:
        query = query.where(date <= wanted.date_to)
    return query


def _matches(connection: Connection, words: str) -> Any:
    """Say what is looked for: words in the description or the category, or exactly this amount, either sign."""
    booking, entry, account = schema.booking.c, schema.entry.c, _CATEGORY.c
    categories = select(account.id).where(account.name.icontains(words, autoescape=True))
    found: list[ColumnElement[bool]] = [
        schema.posting.c.seq.in_(
            union_all(
                select(booking.seq).where(booking.description.icontains(words, autoescape=True)),
                select(entry.seq).where(entry.category_id.in_(categories)),
            )
        )
    ]
    number = words.replace(",", "").strip().lstrip("+-")
    for code in _currencies(connection) if amount_fault(number) is None else ():
        minor = parse_amount(number, code)
        if isinstance(minor, int):
            fits = schema.posting.c.amount.in_([minor, -minor])
            found.append(and_(schema.account.c.currency == code, fits))
    return or_(*found)


def _currencies(connection: Connection) -> list[str]:
    return list(connection.execute(select(schema.account.c.currency).distinct()).scalars())


def _bookings(connection: Connection, seqs: Sequence[int], parked: Container[int]) -> dict[int, Booking]:
    """Return these events, read apart: to find a line must not cost the reading of its event."""
    query = select(schema.event.c.seq, schema.event.c.body).where(schema.event.c.seq.in_(seqs))
    return {
        row.seq: booking_of(connection, row.seq, row.body, parked) for row in connection.execute(query).all()
    }


def _entry(connection: Connection, row: Any, parked: Container[int]) -> EntryView:
    event = booking_of(connection, row.seq, row.body, parked)
    assert isinstance(event, EntryPosted), f"event {row.seq} is listed as an entry and is none"
    return view_entry(event, Place(row.seq, row.epoch, row.booked_ns, row.hash), row.name)


def _entries_query() -> Any:
    stored, event = schema.entry.c, schema.event.c
    return (
        select(event.seq, event.epoch, event.booked_ns, event.hash, event.body, schema.account.c.name)
        .select_from(schema.entry)
        .join(schema.event, event.seq == stored.seq)
        .join(schema.account, schema.account.c.id == stored.account_id)
        .where(stored.reversed == 0)
    )


_CATEGORY: Final = schema.account.alias("category")
_STANDS: Final = schema.posting.c.standing == 1
_HALVES: Final = halves(schema.posting.c.amount)
_LINES: Final = (
    select(
        schema.posting.c.seq,
        schema.posting.c.line,
        schema.posting.c.date,
        schema.posting.c.amount,
        schema.account,
    )
    .select_from(schema.posting)
    .join(schema.account, schema.account.c.id == schema.posting.c.account_id)
    .where(_STANDS)
)
