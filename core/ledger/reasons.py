"""Why the ledger says no: the reasons and rejections, as values.

A rejection is an answer like any other. It is stored under the key of its command and told in two languages,
so it carries words for machines (slug, pointer, reason) and plain values for the sentence, and no sentence.
Exceptions were not chosen: a "no" that travels as a value can't be swallowed on the way or lose its field.
"""

from enum import StrEnum

import msgspec


class Slug(StrEnum):
    """The kinds of a ledger's no; each is a `/problems/<slug>` with a text in the catalogue."""

    INVALID_BODY = "invalid-body"
    UNBALANCED = "unbalanced"
    UNKNOWN_ACCOUNT = "unknown-account"
    ACCOUNT_EXISTS = "account-exists"
    ACCOUNT_CLOSED = "account-closed"
    CURRENCY_DIFFERS = "currency-differs"
    OVERDRAFT = "overdraft"
    BALANCE_OUT_OF_RANGE = "balance-out-of-range"
    CURRENCY_NEEDED = "currency-needed"
    NOT_A_MONEY_ACCOUNT = "not-a-money-account"
    ENTRY_NOT_FOUND = "entry-not-found"
    ENTRY_REVERSED = "entry-reversed"
    ENTRY_CHANGED = "entry-changed"
    ALREADY_IMPORTED = "already-imported"
    TRANSACTION_NOT_FOUND = "transaction-not-found"
    TRANSACTION_REVERSED = "transaction-reversed"
    TRANSACTION_PENDING = "transaction-pending"
    TRANSACTION_OF_ENTRY = "transaction-of-entry"
    ALREADY_A_REVERSAL = "already-a-reversal"
    PENDING_NOT_FOUND = "pending-not-found"
    PENDING_POSTED = "pending-posted"
    PENDING_VOIDED = "pending-voided"
    PENDING_EXPIRED = "pending-expired"
    PENDING_EXCEEDED = "pending-exceeded"
    NOT_YET_EXPIRED = "not-yet-expired"
    ACCOUNT_HAS_PENDING = "account-has-pending"
    ACCOUNT_CHANGED = "account-changed"
    NOT_A_CATEGORY = "not-a-category"
    RECURRING_NOT_FOUND = "recurring-not-found"
    RECURRING_ENDED = "recurring-ended"


class Reason(StrEnum):
    """What is wrong with one field."""

    MISSING = "missing"
    UNKNOWN_FIELD = "unknown_field"
    WRONG_TYPE = "wrong_type"
    MALFORMED = "malformed"
    NAMED_TWICE = "named_twice"
    UNKNOWN_VALUE = "unknown_value"
    NOT_SUPPORTED = "not_supported"
    TOO_LONG = "too_long"
    EMPTY = "empty"
    CONTROL_CHARACTER = "control_character"
    TOO_FEW = "too_few"
    TOO_MANY = "too_many"
    TOO_MANY_DIGITS = "too_many_digits"
    OUT_OF_RANGE = "out_of_range"
    ZERO = "zero"
    NOT_ZERO_SUM = "not_zero_sum"
    UNKNOWN_ACCOUNT = "unknown_account"
    EXISTS = "exists"
    CLOSED = "closed"
    CURRENCY_DIFFERS = "currency_differs"
    OVERDRAFT = "overdraft"
    UNKNOWN_ENTRY = "unknown_entry"
    REVERSED = "reversed"
    CHANGED = "changed"
    UNKNOWN_TRANSACTION = "unknown_transaction"
    PENDING = "pending"
    POSTED = "posted"
    VOIDED = "voided"
    EXPIRED = "expired"
    NOT_DUE = "not_due"
    EXCEEDS_PENDING = "exceeds_pending"
    OF_ENTRY = "of_entry"
    IS_REVERSAL = "is_reversal"


class Fault(msgspec.Struct, frozen=True):
    """One field that is wrong: its JSON pointer in the body (empty: the whole) and the reason."""

    pointer: str
    reason: Reason


class Rejection(msgspec.Struct, frozen=True):
    """A no: what kind, which fields, and the values its sentence names."""

    slug: Slug
    faults: tuple[Fault, ...] = ()
    values: dict[str, str] = {}


def reject(slug: Slug, pointer: str, reason: Reason, **values: str) -> Rejection:
    """Return a rejection with one fault."""
    return Rejection(slug, (Fault(pointer, reason),), values)


def within(rejection: Rejection, pointer: str) -> Rejection:
    """Return a rejection of a part as one of the whole, in which the part stands at `pointer`."""
    faults = tuple(Fault(pointer + fault.pointer, fault.reason) for fault in rejection.faults)
    return Rejection(rejection.slug, faults, rejection.values)
