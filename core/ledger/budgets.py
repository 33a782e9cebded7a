"""Budgets: what is meant for a category in a month, beside what was spent.

Pure: the rows were read, here they get their meaning. People read spending and income as positive numbers, so what was
spent is shown in the sense of its account. What is left of a budget may be negative; that is the point of it.
"""

import msgspec

from core.ledger.accounts import Account, AccountType
from core.ledger.money import format_amount


class BudgetLine(msgspec.Struct, frozen=True):
    """What is meant for a category in a month, and what was spent (of income: came in), both positive.

    `since`: the month from which `amount` holds. `left` is less than zero where more was spent than was meant.
    `used_percent`: rounded for the eye; null where nothing was meant.
    """

    account: str
    name: str | None
    type: str
    currency: str
    amount: str
    since: str
    spent: str
    left: str
    used_percent: float | None


def view_budget(account: Account, name: str | None, amount: int, since: str, moved: int) -> BudgetLine:
    """Return what is meant for a category beside what its account has moved in the month, debit positive."""
    spent = -moved if account.type is AccountType.INCOME else moved
    return BudgetLine(
        account=account.id,
        name=name,
        type=account.type.value,
        currency=account.currency,
        amount=format_amount(amount, account.currency),
        since=since,
        spent=format_amount(spent, account.currency),
        left=format_amount(amount - spent, account.currency),
        used_percent=round(spent * 100 / amount, 1) if amount else None,
    )
