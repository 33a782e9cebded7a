"""An account: one name, one type, one currency, one balance.

Debits are positive whatever the type, so all balances of a currency add up to zero and nobody has to know a
sign convention to check it. Which side is the good one matters in a single place: an account that may not be
overdrawn is judged in its natural sense. An account holds one currency; exchange goes through two accounts.
"""

import re
from enum import StrEnum
from typing import Final, assert_never

import msgspec

_ID: Final = re.compile(r"[a-z0-9][a-z0-9:_-]{0,127}")


class AccountType(StrEnum):
    """The five kinds of double entry."""

    ASSET = "asset"
    LIABILITY = "liability"
    EQUITY = "equity"
    INCOME = "income"
    EXPENSE = "expense"


class Account(msgspec.Struct, frozen=True):
    """An account as it stands. `posted` is in minor units of `currency`, debit positive."""

    id: str
    name: str
    type: AccountType
    currency: str
    no_overdraft: bool
    posted: int = 0
    closed: bool = False


def is_account_id(text: str) -> bool:
    """Whether `text` may name an account."""
    return _ID.fullmatch(text) is not None


def is_overdrawn(kind: AccountType, posted: int) -> bool:
    """Whether the balance stands on the unnatural side of zero for an account of this type.

    What one owns or spends is a debit and may not fall below zero; what one owes or earns is a credit and
    may not rise above it.
    """
    match kind:
        case AccountType.ASSET | AccountType.EXPENSE:
            return posted < 0
        case AccountType.LIABILITY | AccountType.EQUITY | AccountType.INCOME:
            return posted > 0
        case _:
            assert_never(kind)
