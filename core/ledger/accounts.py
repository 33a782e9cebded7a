"""An account: one name, one type, one currency, one balance.

Debits are positive whatever the type, so all balances of a currency add up to zero and nobody has to know a
sign convention to check it. Which side is the good one matters in a single place: an account that may not be
overdrawn is judged in its natural sense. An account holds one currency; exchange goes through two accounts.
What is pending is kept beside it as two sums, one for each side, because what may still go out is spoken for and
what may still come in is not there yet: one net number could not tell a hundred each way from nothing at all.
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
    """An account as it stands. `posted` is in minor units of `currency`, debit positive.

    `pending_debit` and `pending_credit` are what open pending transactions would post to either side, neither ever
    negative. `version`: how many events have touched it.
    """

    id: str
    name: str
    type: AccountType
    currency: str
    no_overdraft: bool
    posted: int = 0
    closed: bool = False
    pending_debit: int = 0
    pending_credit: int = 0
    version: int = 0

    @property
    def pending(self) -> int:
        """What is pending on both sides together, debit positive."""
        return self.pending_debit - self.pending_credit

    @property
    def has_pending(self) -> bool:
        """Whether a pending transaction that is open has a line here."""
        return self.pending_debit != 0 or self.pending_credit != 0

    @property
    def available(self) -> int:
        """What is posted less what may still go out in the natural sense of the account, debit positive."""
        if is_debit_natured(self.type):
            return self.posted - self.pending_credit
        return self.posted + self.pending_debit


def is_account_id(text: str) -> bool:
    """Whether `text` may name an account."""
    return _ID.fullmatch(text) is not None


def is_debit_natured(kind: AccountType) -> bool:
    """Whether the natural side of an account of this type is the debit: what one owns or spends."""
    match kind:
        case AccountType.ASSET | AccountType.EXPENSE:
            return True
        case AccountType.LIABILITY | AccountType.EQUITY | AccountType.INCOME:
            return False
        case _:
            assert_never(kind)


def is_overdrawn(kind: AccountType, balance: int) -> bool:
    """Whether the balance stands on the unnatural side of zero for an account of this type.

    What one owns or spends is a debit and may not fall below zero; what one owes or earns is a credit and
    may not rise above it.
    """
    return balance < 0 if is_debit_natured(kind) else balance > 0
