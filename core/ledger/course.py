"""The course of a year: what came in and was spent in each month, and what was owned at its end.

Pure: somebody read the sums, here they become months. What was owned at the end of a month is what is owned now less
what has moved since, days to come included; so the last point is the number that stands above the drawing, to the
unit. Balances kept month by month were not chosen: an entry for last spring would rewrite all months since.
"""

from collections.abc import Iterable, Mapping, Sequence

import msgspec

from core.ledger.accounts import AccountType
from core.ledger.household import CATEGORY_TYPES, MONEY_TYPES
from core.ledger.money import format_amount

MONTHS: int = 12


class Moved(msgspec.Struct, frozen=True):
    """What stands in one month (YYYY-MM) on all accounts of a type and currency together, debit positive, in minor units."""

    month: str
    type: AccountType
    currency: str
    amount: int


class Month(msgspec.Struct, frozen=True):
    """A month in one currency: income and expense both positive, and what was owned at its end."""

    month: str
    income: str
    expense: str
    worth: str


class Course(msgspec.Struct, frozen=True):
    """The months of one currency, the oldest first."""

    currency: str
    months: tuple[Month, ...]


def months_until(last: str, count: int = MONTHS) -> tuple[str, ...]:
    """Return `count` months (YYYY-MM) in their order, of which `last` is the last one; none lies before the year 1."""
    year, number = (int(part) for part in last.split("-"))
    at = year * 12 + number - 1
    return tuple(f"{one // 12:04d}-{one % 12 + 1:02d}" for one in range(max(at - count + 1, 12), at + 1))


def courses(months: Sequence[str], worth: Mapping[str, int], moved: Iterable[Moved]) -> tuple[Course, ...]:
    """Return the course of each currency that something moved in, the one that moved most often first.

    `worth` is what is owned now by currency, `moved` everything that stands from the first of `months` on. A currency in
    which nothing came in or was spent within these months is left out.
    """
    sums: dict[tuple[str, str, bool | AccountType], int] = {}
    busy: dict[str, int] = {}
    for one in moved:
        which = (one.currency, one.month, True if one.type in MONEY_TYPES else one.type)
        sums[which] = sums.get(which, 0) + one.amount
        if one.type in CATEGORY_TYPES and one.amount and one.month in months:
            busy[one.currency] = busy.get(one.currency, 0) + 1
    return tuple(
        _course(code, months, worth.get(code, 0), sums)
        for code in sorted(busy, key=lambda code: (-busy[code], code))
    )


def _course(
    code: str, months: Sequence[str], worth: int, sums: Mapping[tuple[str, str, bool | AccountType], int]
) -> Course:
    later = sum(
        amount
        for (of, month, kind), amount in sums.items()
        if of == code and kind is True and month > months[-1]
    )
    standing = worth - later
    told: list[Month] = []
    for month in reversed(months):
        income = -sums.get((code, month, AccountType.INCOME), 0)
        expense = sums.get((code, month, AccountType.EXPENSE), 0)
        told.append(Month(month, *(format_amount(amount, code) for amount in (income, expense, standing))))
        standing -= sums.get((code, month, True), 0)
    return Course(code, tuple(reversed(told)))
