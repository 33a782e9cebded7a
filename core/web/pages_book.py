"""What each page sees of the book: one function per page, all its questions inside one snapshot.

The numbers of a page must agree with each other: a balance beside an entry that it does not hold yet would look
like a fault. So a page asks once, on a reader's thread, and gets a picture; how it is drawn is the templates'.
`parked` are the events that are left out, and not read for a page either.
"""

import calendar
import datetime as dt
import urllib.parse
from collections import Counter
from collections.abc import Container, Iterable, Mapping, Sequence
from functools import partial
from typing import Final

import msgspec
from sqlalchemy import Connection

from core.journal import planned, queries
from core.journal.register import (
    HouseholdFilter,
    Position,
    courses_of,
    get_entry,
    list_entries,
    list_register,
    summary_of,
)
from core.ledger.accounts import Account, AccountType
from core.ledger.budgets import BudgetLine
from core.ledger.course import Course, months_until
from core.ledger.events import PostingLine
from core.ledger.household import CATEGORY_TYPES, MONEY_TYPES
from core.ledger.money import format_amount
from core.ledger.overview import CategoryTotal, Flow, RegisterLine, Summary, category_name
from core.ledger.plan_views import RecurringView
from core.ledger.views import AssertionView, EntryView, TransactionView
from core.web.intake import make_position, read_position

BARS_MAX: Final = 12
COURSES_MAX: Final = 3
PENDINGS_MAX: Final = 5
RECURRING_MAX: Final = 200
ASSERTED_MAX: Final = 3
# Among these a household's first account is looked for; later ones stand in the order of the list.
FIRST_RECORDS: Final = 200
_GROUPS: Final = (*MONEY_TYPES, *CATEGORY_TYPES, AccountType.EQUITY)
# People read what they earned and what they began with as positive; inside, both are credits.
_CREDITS: Final = frozenset({AccountType.INCOME, AccountType.EQUITY})


class ShownAccount(msgspec.Struct, frozen=True):
    """An account as pages show it: `balance` has the sign that people expect of this kind of account.

    `pending` and `available` are None where nothing is pending on it.
    """

    id: str
    name: str
    type: str
    currency: str
    closed: bool
    balance: str
    pending: str | None = None
    available: str | None = None


class OverviewPicture(msgspec.Struct, frozen=True):
    """The overview. `accounts` is empty in a book that has none at all.

    `first_account` is the id of the one of `money_accounts` that was made first, empty where there is none.
    """

    accounts: Sequence[ShownAccount]
    money_accounts: Sequence[ShownAccount]
    first_account: str
    categories: Sequence[str]
    summary: Summary
    flows: Sequence[Flow]
    spent: Sequence[CategoryTotal]
    recent: Sequence[EntryView]
    courses: Sequence[Course]
    pendings: Sequence[TransactionView]


class RegisterPicture(msgspec.Struct, frozen=True):
    """One page of the register, of one account or of all."""

    account: ShownAccount | None
    accounts: Sequence[ShownAccount]
    lines: Sequence[RegisterLine]
    next_cursor: str | None
    asserted: Sequence[AssertionView] = ()


class ShownLine(msgspec.Struct, frozen=True):
    """One line of a transaction, with what its account is called, on the side where it stands: one of the two is empty."""

    account: str
    name: str
    currency: str
    debit: str
    credit: str


class TransactionPicture(msgspec.Struct, frozen=True):
    """A transaction, booked or pending, and its lines as the books have them."""

    seen: TransactionView
    lines: Sequence[ShownLine]


class PlansPicture(msgspec.Struct, frozen=True):
    """A month's budgets, the categories that have none, what comes back, and what the forms can choose from."""

    budgets: Sequence[BudgetLine]
    free: Sequence[ShownAccount]
    items: Sequence[RecurringView]
    money_accounts: Sequence[ShownAccount]
    categories: Sequence[str]


class EntryPicture(msgspec.Struct, frozen=True):
    """An entry and what its form can choose from."""

    entry: EntryView
    accounts: Sequence[ShownAccount]
    categories: Sequence[str]


def overview(
    connection: Connection, month: str, last_month: str, recent_max: int, parked: Container[int]
) -> OverviewPicture:
    """Return what the overview shows of a month (YYYY-MM), and of the year that ends with `last_month`."""
    accounts = _accounts(connection)
    choices = _money_accounts(accounts)
    year, number = (int(part) for part in month.split("-"))
    last_day = calendar.monthrange(year, number)[1]
    summary = summary_of(connection, month, f"{month}-01", f"{month}-{last_day:02d}")
    spent = [line for line in summary.categories if line.type == AccountType.EXPENSE.value]
    return OverviewPicture(
        accounts=[_shown(account) for account in accounts],
        money_accounts=choices,
        first_account=_first_of(connection, choices, parked),
        categories=_category_names(accounts),
        summary=summary,
        flows=[flow for flow in summary.currencies if _moved(flow)] or summary.currencies[:1],
        spent=spent[:BARS_MAX],
        recent=list_entries(connection, HouseholdFilter(limit=recent_max), parked),
        courses=courses_of(connection, months_until(last_month))[:COURSES_MAX],
        pendings=queries.list_pendings(connection, parked, limit=PENDINGS_MAX),
    )


def register(
    connection: Connection, asked: Mapping[str, str], limit: int, parked: Container[int]
) -> RegisterPicture:
    """Return a page of the register; `asked` holds account, q, from, to and cursor, empty where not asked."""
    place = read_position(asked["cursor"])
    accounts = _accounts(connection)
    wanted = HouseholdFilter(
        account=asked["account"] or None,
        date_from=asked["from"] or None,
        date_to=asked["to"] or None,
        words=asked["q"] or None,
        after=Position(*place) if place else None,
        limit=limit + 1,
    )
    found = list_register(connection, wanted, parked)
    lines = found[:limit]
    last = lines[-1] if lines else None
    account = queries.get_account(connection, wanted.account) if wanted.account is not None else None
    if account is not None and account.type in _CREDITS:
        lines = [_other_way(line) for line in lines]
    return RegisterPicture(
        account=_shown(account) if account else None,
        accounts=_money_accounts(accounts),
        lines=lines,
        next_cursor=make_position(last.date, last.seq, last.line) if last and len(found) > limit else None,
        asserted=queries.list_assertions(connection, parked, account.id, limit=ASSERTED_MAX)
        if account
        else (),
    )


def account_groups(connection: Connection) -> list[tuple[str, list[ShownAccount]]]:
    """Return all accounts by their kind, open ones first; kinds that have none are left out."""
    accounts = _accounts(connection)
    groups = [(kind, [one for one in accounts if one.type is kind]) for kind in _GROUPS]
    in_order = partial(sorted, key=lambda one: (one.closed, *_place_in_list(one)))
    return [(kind.value, [_shown(one) for one in in_order(group)]) for kind, group in groups if group]


def money_accounts(connection: Connection) -> list[ShownAccount]:
    """Return the open accounts that money moves on."""
    return _money_accounts(_accounts(connection))


def transaction(
    connection: Connection, transaction_id: str, parked: Container[int]
) -> TransactionPicture | None:
    """Return a transaction with what its accounts are called; None if none has this id."""
    seen = queries.get_transaction(connection, transaction_id, parked)
    if seen is None:
        return None
    named = {
        one: queries.get_account(connection, one)
        for one in dict.fromkeys(line.account for line in seen.postings)
    }
    return TransactionPicture(seen, [_shown_line(line, named[line.account]) for line in seen.postings])


def plans(
    connection: Connection, month: str, days: tuple[str, str], today: dt.date, parked: Container[int]
) -> PlansPicture:
    """Return what the page of plans shows of a month, given with its first and last day."""
    accounts = _accounts(connection)
    budgets = planned.budgets_of(connection, month, *days)
    taken = {line.account for line in budgets}
    kinds = (AccountType.EXPENSE, AccountType.INCOME)
    free = [one for one in accounts if one.type in kinds and not one.closed and one.id not in taken]
    return PlansPicture(
        budgets=budgets,
        free=[_shown(one) for one in sorted(free, key=_place_in_list)],
        items=planned.list_recurring(connection, None, RECURRING_MAX, today, parked),
        money_accounts=_money_accounts(accounts),
        categories=_category_names(accounts),
    )


def recurring(
    connection: Connection, item_id: str, today: dt.date, parked: Container[int]
) -> RecurringView | None:
    """Return a recurring item with what became of its last days; None if none has this id."""
    return planned.get_recurring(connection, item_id, today, parked)


def entry(connection: Connection, entry_id: str, parked: Container[int]) -> EntryPicture | None:
    """Return an entry with what its form needs; None if none stands under this id."""
    found = get_entry(connection, entry_id, parked)
    if found is None:
        return None
    accounts = _accounts(connection)
    choices = _money_accounts(accounts)
    # The account of an old entry may be closed by now; it stays what the form says until somebody changes it.
    if all(one.id != found.account for one in choices):
        choices += [_shown(one) for one in accounts if one.id == found.account]
    return EntryPicture(found, choices, _category_names(accounts))


def repeated(names: Iterable[str | None]) -> frozenset[str | None]:
    """Return the names that stand more than once in a list: only their currency tells them apart."""
    return frozenset(name for name, times in Counter(names).items() if times > 1)


def register_link(asked: Mapping[str, str]) -> str:
    """Return the address of a page of the register."""
    return "/register?" + urllib.parse.urlencode({name: value for name, value in asked.items() if value})


def _other_way(line: RegisterLine) -> RegisterLine:
    """Return a line of what was earned or begun with in the sign in which people read the balance above it."""
    return msgspec.structs.replace(line, amount=_opposite(line.amount), balance=_opposite(line.balance))


def _opposite(amount: str) -> str:
    return amount.removeprefix("-") if amount.startswith("-") or not amount.strip("0.") else f"-{amount}"


def _moved(flow: Flow) -> bool:
    return any(amount.strip("-0.") for amount in (flow.income, flow.expense))


def _accounts(connection: Connection) -> list[Account]:
    # Each kind has a bound of its own: however many categories there are, no bank account falls out of a page.
    kinds = (MONEY_TYPES, CATEGORY_TYPES, (AccountType.EQUITY,))
    return [
        account
        for types in kinds
        for account in queries.list_accounts(connection, None, queries.ACCOUNTS_MAX, types)
    ]


def _money_accounts(accounts: Sequence[Account]) -> list[ShownAccount]:
    found = [one for one in accounts if one.type in MONEY_TYPES and not one.closed]
    return [_shown(one) for one in sorted(found, key=_place_in_list)]


def _place_in_list(account: Account) -> tuple[int, str, str]:
    """Return where an account stands in every list of a page: what one has before what one owes, then by name."""
    return _GROUPS.index(account.type), account.name.casefold(), account.id


def _first_of(connection: Connection, choices: Sequence[ShownAccount], parked: Container[int]) -> str:
    """Return the account that was opened first, what one has before what one owes; it never changes by itself."""
    first = queries.first_opened(connection, FIRST_RECORDS, parked)
    opened = {name: at for at, name in enumerate(first)}
    oldest = min(
        choices,
        key=lambda one: (one.id not in opened, one.type != AccountType.ASSET.value, opened.get(one.id, 0)),
        default=None,
    )
    return oldest.id if oldest is not None else ""


def _category_names(accounts: Sequence[Account]) -> list[str]:
    named = (category_name(one) for one in accounts if one.type in CATEGORY_TYPES and not one.closed)
    return sorted({name for name in named if name is not None}, key=str.casefold)


def _shown_line(line: PostingLine, account: Account | None) -> ShownLine:
    name = _shown(account).name if account is not None else line.account
    is_credit = line.amount.startswith("-")
    return ShownLine(
        line.account,
        name,
        line.currency,
        "" if is_credit else line.amount,
        line.amount.removeprefix("-") if is_credit else "",
    )


def _shown(account: Account) -> ShownAccount:
    # The reserved account has a name for every language at once; pages say it in the reader's.
    name = (category_name(account) if account.type in CATEGORY_TYPES else account.name) or ""
    sign = -1 if account.type in _CREDITS else 1
    told = [
        format_amount(sign * amount, account.currency)
        for amount in (account.posted, account.pending, account.available)
    ]
    beside = told[1:] if account.has_pending else [None, None]
    return ShownAccount(
        account.id, name, account.type.value, account.currency, account.closed, told[0], *beside
    )
