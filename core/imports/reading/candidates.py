"""What a row can become: a candidate for the book, a refusal with its reason, or a skip with its reason.

Three kinds and no fourth: every row of a file is one of them, so that the numbers a person reads (good,
refused, skipped) always add up to the rows of the file.
"""

from enum import StrEnum

import msgspec

from core.ledger.money import format_amount


class Refusal(StrEnum):
    """Why a row can't be booked as it stands; each has a sentence in the catalogue."""

    NO_DATE = "no-date"
    BAD_DATE = "bad-date"
    NO_SUCH_DATE = "no-such-date"
    NO_YEAR = "no-year"
    AMBIGUOUS_DATE = "ambiguous-date"
    NO_AMOUNT = "no-amount"
    BAD_AMOUNT = "bad-amount"
    EXPONENT = "exponent-amount"
    TOO_MANY_DIGITS = "too-many-digits"
    OUT_OF_RANGE = "amount-out-of-range"
    BOTH_SIDES = "both-sides"
    SIGN_CONFLICT = "sign-conflict"
    UNKNOWN_DIRECTION = "unknown-direction"
    UNKNOWN_STATUS = "unknown-status"
    NO_CURRENCY = "no-currency"
    BAD_CURRENCY = "bad-currency"
    BAD_FEE = "bad-fee"
    TOO_MANY_CATEGORIES = "too-many-categories"


class Skip(StrEnum):
    """Why a row is none to be booked; each has a sentence in the catalogue."""

    BLANK = "blank"
    HEADER = "header"
    FOOTER = "footer"
    NOTE = "note"
    PENDING = "pending"
    REVERTED = "reverted"
    NO_MOVEMENT = "no-movement"


class Candidate(msgspec.Struct, frozen=True):
    """A row that can be booked.

    `amount_minor` and `balance_minor` are minor units of `currency`; minus means spent. `identity` and
    `ordinal` are what `fingerprints.fingerprint` is made of: the unchanging cells, and which of several
    identical rows of the file this is, from 1.
    """

    line: int
    cells: tuple[str, ...]
    date: str
    amount_minor: int
    currency: str
    description: str
    memo: str | None
    category: str | None
    payment_method: str | None
    balance_minor: int | None
    identity: tuple[str, ...]
    ordinal: int

    @property
    def amount(self) -> str:
        """The amount as a decimal string with the digits of its currency."""
        return format_amount(self.amount_minor, self.currency)

    @property
    def balance(self) -> str | None:
        """The running balance as a decimal string, when the file has one."""
        return None if self.balance_minor is None else format_amount(self.balance_minor, self.currency)


class RefusedRow(msgspec.Struct, frozen=True):
    """A row that can't be booked, and the column at which that was seen, when it was one."""

    line: int
    cells: tuple[str, ...]
    reason: Refusal
    column: str | None = None


class SkippedRow(msgspec.Struct, frozen=True):
    """A row that is none to be booked: a total, a repeated header, a purchase still pending."""

    line: int
    cells: tuple[str, ...]
    reason: Skip


Result = Candidate | RefusedRow | SkippedRow
