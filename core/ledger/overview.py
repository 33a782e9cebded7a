"""What a household looks at: the register's lines, a month in sums, and its categories.

Pure: somebody read the rows, here they get their meaning and their signs. Inside, debits are positive; people
read income and spending as two positive numbers and what they own less what they owe as one. Shares are the
only numbers that are no amounts, rounded for the eye and never used to compute money.
"""

from collections.abc import Iterable, Mapping, Sequence

import msgspec

from core.ledger.accounts import Account, AccountType
from core.ledger.book import is_uncategorised
from core.ledger.budgets import BudgetLine
from core.ledger.events import Booking, EntryPosted, TransactionReversed
from core.ledger.household import CATEGORY_TYPES
from core.ledger.money import format_amount
from core.ledger.views import AccountView, view_account


class RegisterLine(msgspec.Struct, frozen=True):
    """One standing posting of an account.

    `balance` is that of the account after this line, in the order of days. `entry` is null for what was booked
    as a bare transaction; `counterparts` are the accounts on its other side.
    """

    seq: int
    line: int
    transaction: str
    entry: str | None
    date: str
    description: str
    account: str
    account_name: str
    amount: str
    currency: str
    balance: str
    category: str | None
    payment_method: str | None
    tags: tuple[str, ...]
    counterparts: tuple[str, ...]


class CategoryView(msgspec.Struct, frozen=True):
    """A category: an account of income or expense. `name` null: what has no category."""

    account: str
    name: str | None
    type: str
    currency: str
    last_used: str | None


class CurrencyAmount(msgspec.Struct, frozen=True):
    """An amount of one currency."""

    currency: str
    amount: str


class Flow(msgspec.Struct, frozen=True):
    """What came in and what was spent in one currency, both positive, and what was left of it."""

    currency: str
    income: str
    expense: str
    net: str


class CategoryTotal(msgspec.Struct, frozen=True):
    """What came in or was spent under one category.

    `share_percent`: of all income or expense in its currency, to one digit; 0 where that makes no sense.
    """

    account: str
    name: str | None
    type: str
    currency: str
    amount: str
    share_percent: float


class Summary(msgspec.Struct, frozen=True):
    """A month in sums (by the days of its entries), what is owned now, and what was meant to be spent in the month."""

    month: str
    net_worth: tuple[CurrencyAmount, ...]
    currencies: tuple[Flow, ...]
    categories: tuple[CategoryTotal, ...]
    accounts: tuple[AccountView, ...]
    budgets: tuple[BudgetLine, ...]


class StandingLine(msgspec.Struct, frozen=True):
    """A standing posting as it was read: where it stands, its event, its account, and the balance after it."""

    seq: int
    line: int
    event: Booking
    account: Account
    amount: int
    balance: int


def view_line(standing: StandingLine) -> RegisterLine:
    """Return a line of the register as answers show it."""
    event, account = standing.event, standing.account
    entry = event if isinstance(event, EntryPosted) else None
    names = dict.fromkeys(line.account for line in event.postings if line.account != account.id)
    return RegisterLine(
        seq=standing.seq,
        line=standing.line,
        transaction=event.id,
        entry=entry.entry if entry else None,
        date=event.date,
        description=event.description,
        account=account.id,
        account_name=account.name,
        amount=format_amount(standing.amount, account.currency),
        currency=account.currency,
        balance=format_amount(standing.balance, account.currency),
        category=entry.category if entry else None,
        payment_method=entry.payment_method if entry else None,
        tags=() if isinstance(event, TransactionReversed) else event.tags,
        counterparts=tuple(names),
    )


def view_category(account: Account, last_used: str | None) -> CategoryView:
    """Return a category as answers show it."""
    return CategoryView(account.id, category_name(account), account.type.value, account.currency, last_used)


def category_name(account: Account) -> str | None:
    """Return what the category is called, None for the account of what has none."""
    return None if is_uncategorised(account.id) else account.name


def summarise(
    month: str,
    worth: Mapping[str, int],
    money: Iterable[Account],
    moved: Sequence[tuple[Account, int]],
    budgets: tuple[BudgetLine, ...] = (),
) -> Summary:
    """Return a month in sums; all sums are debit positive, in minor units.

    `worth` is the sum of all accounts of money by currency, `money` the open ones that are told one by one;
    `moved` are all categories that something stands on in that month, each with its sum.
    """
    totals: dict[tuple[AccountType, str], int] = {}
    for account, amount in moved:
        which = (account.type, account.currency)
        totals[which] = totals.get(which, 0) + _natural(account, amount)
    return Summary(
        month,
        tuple(CurrencyAmount(code, format_amount(amount, code)) for code, amount in sorted(worth.items())),
        tuple(_flow(code, totals) for code in sorted({*worth, *(code for _, code in totals)})),
        tuple(_total(account, amount, totals) for account, amount in sorted(moved, key=_largest_first)),
        tuple(view_account(account) for account in money),
        budgets,
    )


def _flow(code: str, totals: Mapping[tuple[AccountType, str], int]) -> Flow:
    income = totals.get((AccountType.INCOME, code), 0)
    expense = totals.get((AccountType.EXPENSE, code), 0)
    return Flow(
        code, format_amount(income, code), format_amount(expense, code), format_amount(income - expense, code)
    )


def _total(account: Account, moved: int, totals: Mapping[tuple[AccountType, str], int]) -> CategoryTotal:
    amount, whole = _natural(account, moved), totals[account.type, account.currency]
    share = round(100 * amount / whole, 1) if amount > 0 and whole >= amount else 0.0
    return CategoryTotal(
        account.id,
        category_name(account),
        account.type.value,
        account.currency,
        format_amount(amount, account.currency),
        share,
    )


def _largest_first(moved: tuple[Account, int]) -> tuple[int, str, int, str]:
    """Sort spending before income, each currency by itself, the largest first."""
    account, amount = moved
    return CATEGORY_TYPES.index(account.type), account.currency, -_natural(account, amount), account.id


def _natural(account: Account, moved: int) -> int:
    return -moved if account.type is AccountType.INCOME else moved
