"""A mapping: which column is what, and how dates and numbers of this file are written.

It is the one thing a person may change before rows are read, so it is small, complete and shown as it is.
Nothing in it is decided per cell: one date order, one decimal mark, one meaning of a positive number for the
whole file. Formats of banks end up as a mapping too, so that there is one way to read a row and not two.
"""

from collections.abc import Iterator
from enum import StrEnum
from types import MappingProxyType
from typing import Final

import msgspec

from core.ledger.money import is_currency


class DateOrder(StrEnum):
    """The order of year, month and day. Separators don't matter, a time behind the date is allowed."""

    YMD = "ymd"
    MDY = "mdy"
    DMY = "dmy"


class Decimal(StrEnum):
    """The mark before the fraction; the other one may separate thousands."""

    POINT = "."
    COMMA = ","


class Positive(StrEnum):
    """What a positive number in the amount column means for the household."""

    IN = "in"
    OUT = "out"


class Mapping(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename={"inflow": "in", "outflow": "out"}
):
    """Roles and the columns that play them. `date_format` null means: nobody has said yet."""

    date: str | None = None
    time: str | None = None
    amount: str | None = None
    inflow: str | None = None
    outflow: str | None = None
    direction: str | None = None
    description: str | None = None
    detail: str | None = None
    memo: str | None = None
    category: str | None = None
    payment_method: str | None = None
    balance: str | None = None
    currency: str | None = None
    fee: str | None = None
    status: str | None = None
    date_format: DateOrder | None = None
    decimal: Decimal = Decimal.POINT
    positive: Positive = Positive.IN
    currency_code: str | None = None


#: The wire's names of the roles, each with the attribute that holds it.
ROLES: Final = MappingProxyType(
    {
        "date": "date",
        "time": "time",
        "amount": "amount",
        "in": "inflow",
        "out": "outflow",
        "direction": "direction",
        "description": "description",
        "detail": "detail",
        "memo": "memo",
        "category": "category",
        "payment_method": "payment_method",
        "balance": "balance",
        "currency": "currency",
        "fee": "fee",
        "status": "status",
    }
)


class FaultKind(StrEnum):
    """What keeps a mapping from being used; each has a sentence in the catalogue."""

    UNKNOWN_COLUMN = "mapping-unknown-column"
    COLUMN_TWICE = "mapping-column-twice"
    NO_DATE = "mapping-no-date"
    NO_AMOUNT = "mapping-no-amount"
    TWO_AMOUNTS = "mapping-two-amounts"
    NO_DATE_FORMAT = "ambiguous-date"
    BAD_CURRENCY = "mapping-bad-currency"


class MappingFault(msgspec.Struct, frozen=True):
    """One fault, and the wire's name of the field it is about."""

    field: str
    kind: FaultKind


def column_of(mapping: Mapping, role: str) -> str | None:
    """The column that plays `role` (a name of the wire), or None."""
    column: str | None = getattr(mapping, ROLES[role])
    return column


def faults_of(mapping: Mapping, columns: tuple[str, ...]) -> tuple[MappingFault, ...]:
    """Everything that keeps `mapping` from being used on a table with these columns; empty when it fits."""
    return (*_column_faults(mapping, columns), *_meaning_faults(mapping))


def _column_faults(mapping: Mapping, columns: tuple[str, ...]) -> Iterator[MappingFault]:
    used: set[str] = set()
    for role in ROLES:
        column = column_of(mapping, role)
        if column is None:
            continue
        if column not in columns:
            yield MappingFault(role, FaultKind.UNKNOWN_COLUMN)
        # Date and time often share a cell; any other two roles in one column are a slip of the hand.
        elif column in used and role != "time":
            yield MappingFault(role, FaultKind.COLUMN_TWICE)
        used.add(column)


def _meaning_faults(mapping: Mapping) -> Iterator[MappingFault]:
    if mapping.date is None:
        yield MappingFault("date", FaultKind.NO_DATE)
    elif mapping.date_format is None:
        yield MappingFault("date_format", FaultKind.NO_DATE_FORMAT)
    sides = mapping.inflow is not None or mapping.outflow is not None
    if mapping.amount is None and not sides:
        yield MappingFault("amount", FaultKind.NO_AMOUNT)
    if mapping.amount is not None and sides:
        yield MappingFault("amount", FaultKind.TWO_AMOUNTS)
    if mapping.currency_code is not None and not is_currency(mapping.currency_code):
        yield MappingFault("currency_code", FaultKind.BAD_CURRENCY)
