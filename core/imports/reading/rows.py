"""Judges rows: each becomes a candidate, a refusal with its reason, or a skip with its reason.

A pure walk over the table. The mapping says which column is what, the format which words its columns may hold;
a word that neither knows stops the row, because a guess would book money in the wrong direction. Nothing of
one row changes how another is read, except the count of identical rows that goes into the fingerprint, and the
bound on categories, because each of them opens accounts.
"""

import re
from collections import Counter
from collections.abc import Iterator
from typing import Final

import msgspec

from core.imports.reading.amounts import Number, parse_number, to_minor
from core.imports.reading.candidates import Candidate, Refusal, RefusedRow, Result, Skip, SkippedRow
from core.imports.reading.dates import parse_date
from core.imports.reading.fingerprints import settled
from core.imports.reading.formats import Format
from core.imports.reading.mapping import ROLES, Mapping, Positive, column_of
from core.imports.reading.names import canonical, header_text, tidy
from core.imports.reading.roles import (
    DIRECTION_IN,
    DIRECTION_OUT,
    NUMBERING,
    STATUS_BOOKED,
    STATUS_PENDING,
    STATUS_REVERTED,
)
from core.imports.reading.table import Row, Table
from core.ledger.money import fits, is_currency

# Well below what the book takes; the whole cell stays in `cells`.
DESCRIPTION_CHARACTERS_MAX: Final = 500
NAME_CHARACTERS_MAX: Final = 100
#: Each opens an account, and one for money in and one for money out; no household has as many.
CATEGORIES_MAX: Final = 200

_FOOTER: Final = re.compile(
    r"(합계|총합계|소계|총계|누계|총[0-9,]+건|[0-9,]+건$|합산|grandtotal|total|subtotal|合計|小計|summe|gesamt).*"
)
_BESIDE_ID: Final = frozenset({"date", "amount", "in", "out", "fee", "currency"})
_CONFLICT: Final = Refusal.SIGN_CONFLICT


class _Words(msgspec.Struct, frozen=True):
    """The words that the direction and the status column may hold, canonical."""

    inflow: frozenset[str]
    outflow: frozenset[str]
    booked: frozenset[str]
    pending: frozenset[str]
    reverted: frozenset[str]


class _Money(msgspec.Struct, frozen=True):
    """An amount that was understood."""

    minor: int
    currency: str


class _Fault(msgspec.Struct, frozen=True):
    """A refusal, and the wire's name of the role whose cell caused it."""

    reason: Refusal
    role: str


class _Reader(msgspec.Struct, frozen=True):
    """Everything that stays the same from row to row, the count of identical rows, and the categories met."""

    mapping: Mapping
    places: dict[str, int]
    header: tuple[str, ...]
    identity: tuple[tuple[str, int], ...]
    bank_id: tuple[tuple[str, int], ...]
    words: _Words
    notes: tuple[str, ...]
    account_currency: str | None
    seen: Counter[tuple[str, ...]] = msgspec.field(default_factory=Counter)
    categories: set[str] = set()


def parse_rows(
    table: Table,
    mapping: Mapping,
    format_: Format | None,
    account_currency: str | None,
    header_format: Format | None,
) -> Iterator[Result]:
    """What each row of `table` becomes, in order and one at a time.

    `mapping` must fit the table (`mapping.faults_of` is empty but for a missing date order). The currency of a
    row is its own column's, else the mapping's, else the account's. `format_` is the one that was chosen,
    `header_format` the one whose header this is (`proposal.fitting_formats`), whatever was chosen: rows are
    known again by it.
    """
    reader = _Reader(
        mapping=mapping,
        places=_places(table.columns, mapping),
        header=tuple(header_text(column) for column in table.columns),
        identity=_identity(table.columns, header_format),
        bank_id=_bank_id(table.columns, header_format),
        words=_words(format_),
        notes=tuple(map(canonical, format_.notes)) if format_ else (),
        account_currency=account_currency,
    )
    return (_judge(reader, row) for row in table.rows())


def _places(columns: tuple[str, ...], mapping: Mapping) -> dict[str, int]:
    chosen = {role: column_of(mapping, role) for role in ROLES}
    return {role: columns.index(column) for role, column in chosen.items() if column is not None}


def _identity(columns: tuple[str, ...], format_: Format | None) -> tuple[tuple[str, int], ...]:
    """The label and place of each cell that goes into the fingerprint.

    A format names its unchanging roles; without one it is the whole row, but for columns that merely number
    the rows of this one export. Labels keep `100 in` and `100 out` apart when blank cells are left out.
    """
    names = [canonical(column) for column in columns]
    if format_ is None:
        return tuple((name, place) for place, name in enumerate(names) if name not in NUMBERING)
    found: list[tuple[str, int]] = []
    for role in format_.identity:
        accepted = [canonical(name) for name in format_.columns[role]]
        found += [(role, names.index(name)) for name in accepted if name in names][:1]
    return tuple(found)


def _bank_id(columns: tuple[str, ...], format_: Format | None) -> tuple[tuple[str, int], ...]:
    """The place of the bank's own id, first, and of what still tells rows apart where a bank gives one id twice."""
    if format_ is None or not format_.bank_id:
        return ()
    names = [canonical(column) for column in columns]
    own = [("bank_id", names.index(name)) for name in map(canonical, format_.bank_id) if name in names][:1]
    return (*own, *(pair for pair in _identity(columns, format_) if pair[0] in _BESIDE_ID)) if own else ()


def _words(format_: Format | None) -> _Words:
    direction = format_.direction if format_ else None
    status = format_.status if format_ else None
    return _Words(
        inflow=_canonical(direction.inflow) if direction else DIRECTION_IN,
        outflow=_canonical(direction.outflow) if direction else DIRECTION_OUT,
        booked=_canonical(status.booked) if status else STATUS_BOOKED,
        pending=_canonical(status.pending) if status else STATUS_PENDING,
        reverted=_canonical(status.reverted) if status else STATUS_REVERTED,
    )


def _canonical(words: tuple[str, ...]) -> frozenset[str]:
    return frozenset(canonical(word) for word in words)


def _judge(reader: _Reader, row: Row) -> Result:
    date = _date(reader, row)
    if isinstance(date, _Fault):
        skip = _skip_without_date(reader, row)
        return _refused(reader, row, date) if skip is None else SkippedRow(row.line, row.cells, skip)
    status = _status(reader, row)
    if isinstance(status, Skip):
        return SkippedRow(row.line, row.cells, status)
    money = status or _money(reader, row)
    if isinstance(money, _Fault):
        return _refused(reader, row, money) if not _is_note(reader, row, money) else _noted(row)
    if money.minor == 0:
        return SkippedRow(row.line, row.cells, Skip.NO_MOVEMENT)
    candidate = _candidate(reader, row, date, money)
    if not _admitted(reader, candidate.category):
        return _refused(reader, row, _Fault(Refusal.TOO_MANY_CATEGORIES, "category"))
    return candidate


def _is_note(reader: _Reader, row: Row, fault: _Fault) -> bool:
    """Whether a row without an amount is one that its format names as no movement."""
    if fault.reason is not Refusal.NO_AMOUNT or not reader.notes:
        return False
    return canonical(_cell(reader, row, "description")).startswith(reader.notes)


def _noted(row: Row) -> SkippedRow:
    return SkippedRow(row.line, row.cells, Skip.NOTE)


def _refused(reader: _Reader, row: Row, fault: _Fault) -> RefusedRow:
    return RefusedRow(row.line, row.cells, fault.reason, column_of(reader.mapping, fault.role))


def _cell(reader: _Reader, row: Row, role: str) -> str:
    place = reader.places.get(role)
    return "" if place is None else row.cells[place].strip()


def _skip_without_date(reader: _Reader, row: Row) -> Skip | None:
    """What a row without a date is that is no transaction. Asked of no other: a merchant may be called 합계마트."""
    words = tuple(map(canonical, row.cells))
    filled = [word for word in words if word]
    if not filled:
        return Skip.BLANK
    if words == reader.header:
        return Skip.HEADER
    if any(_FOOTER.fullmatch(word) for word in filled):
        return Skip.FOOTER
    return Skip.NOTE if len(filled) == 1 else None


def _date(reader: _Reader, row: Row) -> str | _Fault:
    order = reader.mapping.date_format
    text = _cell(reader, row, "date")
    if not text:
        return _Fault(Refusal.NO_DATE, "date")
    if order is None:
        return _Fault(Refusal.AMBIGUOUS_DATE, "date")
    date = parse_date(text, order)
    return _Fault(date, "date") if isinstance(date, Refusal) else date


def _status(reader: _Reader, row: Row) -> Skip | _Fault | None:
    if "status" not in reader.places:
        return None
    word = canonical(_cell(reader, row, "status"))
    if word in reader.words.pending:
        return Skip.PENDING
    if word in reader.words.reverted:
        return Skip.REVERTED
    return None if word in reader.words.booked else _Fault(Refusal.UNKNOWN_STATUS, "status")


def _money(reader: _Reader, row: Row) -> _Money | _Fault:
    currency = _currency(reader, row)
    if isinstance(currency, _Fault):
        return currency
    minor = (
        _one_column(reader, row, currency)
        if "amount" in reader.places
        else _two_columns(reader, row, currency)
    )
    if isinstance(minor, _Fault):
        return minor
    fee = _minor(reader, row, "fee", currency)
    if isinstance(fee, _Fault):
        return _Fault(Refusal.BAD_FEE, "fee")
    net = minor - (fee or 0)
    return _Money(net, currency) if fits(net) else _Fault(Refusal.OUT_OF_RANGE, "amount")


def _currency(reader: _Reader, row: Row) -> str | _Fault:
    own = _cell(reader, row, "currency").upper()
    code = own or reader.mapping.currency_code or reader.account_currency
    if code is None:
        return _Fault(Refusal.NO_CURRENCY, "currency")
    return code if is_currency(code) else _Fault(Refusal.BAD_CURRENCY, "currency")


def _number(reader: _Reader, row: Row, role: str) -> Number | _Fault | None:
    """The number in the cell of `role`; None for a blank cell or the dash that stands for one."""
    text = _cell(reader, row, role)
    if text in {"", "-"}:
        return None
    number = parse_number(text, reader.mapping.decimal)
    return _Fault(number, role) if isinstance(number, Refusal) else number


def _minor(reader: _Reader, row: Row, role: str, currency: str) -> int | _Fault | None:
    number = _number(reader, row, role)
    if number is None or isinstance(number, _Fault):
        return number
    minor = to_minor(number, currency)
    return _Fault(minor, role) if isinstance(minor, Refusal) else minor


def _one_column(reader: _Reader, row: Row, currency: str) -> int | _Fault:
    number = _number(reader, row, "amount")
    if number is None:
        return _Fault(Refusal.NO_AMOUNT, "amount")
    if isinstance(number, _Fault):
        return number
    minor = to_minor(number, currency)
    if isinstance(minor, Refusal):
        return _Fault(minor, "amount")
    if "direction" in reader.places:
        return _directed(reader, row, number, minor)
    return minor if reader.mapping.positive is Positive.IN else -minor


def _directed(reader: _Reader, row: Row, number: Number, minor: int) -> int | _Fault:
    """The word gives the sign. A sign that was written as well has to agree with it."""
    word = canonical(_cell(reader, row, "direction"))
    if word in reader.words.outflow:
        contradicts = number.signed and not number.negative
        return _Fault(_CONFLICT, "direction") if contradicts else -abs(minor)
    if word in reader.words.inflow:
        return _Fault(_CONFLICT, "direction") if number.negative else abs(minor)
    return _Fault(Refusal.UNKNOWN_DIRECTION, "direction")


def _two_columns(reader: _Reader, row: Row, currency: str) -> int | _Fault:
    inflow = _minor(reader, row, "in", currency)
    outflow = _minor(reader, row, "out", currency)
    if isinstance(inflow, _Fault):
        return inflow
    if isinstance(outflow, _Fault):
        return outflow
    if inflow is None and outflow is None:
        return _Fault(Refusal.NO_AMOUNT, "in" if "in" in reader.places else "out")
    if inflow and outflow:
        return _Fault(Refusal.BOTH_SIDES, "in")
    return (inflow or 0) - (outflow or 0)


def _candidate(reader: _Reader, row: Row, date: str, money: _Money) -> Candidate:
    identity = _identity_of(reader, row)
    reader.seen[identity] += 1
    balance = _minor(reader, row, "balance", money.currency)
    detail = tidy(_cell(reader, row, "detail"), DESCRIPTION_CHARACTERS_MAX)
    described = tidy(_cell(reader, row, "description"), DESCRIPTION_CHARACTERS_MAX)
    memo = tidy(_cell(reader, row, "memo"), DESCRIPTION_CHARACTERS_MAX)
    description = described or detail or memo
    rest = [text for text in (detail, memo) if text and text != description]
    return Candidate(
        line=row.line,
        cells=row.cells,
        date=date,
        amount_minor=money.minor,
        currency=money.currency,
        description=description,
        memo=" · ".join(rest) or None,
        category=tidy(_cell(reader, row, "category"), NAME_CHARACTERS_MAX) or None,
        payment_method=tidy(_cell(reader, row, "payment_method"), NAME_CHARACTERS_MAX) or None,
        # A balance is a witness and is booked nowhere: one that can't be read only doesn't testify.
        balance_minor=balance if isinstance(balance, int) else None,
        identity=identity,
        ordinal=reader.seen[identity],
    )


def _admitted(reader: _Reader, category: str | None) -> bool:
    """Whether a category is among the first of the file: a column of payees is none of categories."""
    if category is None or category in reader.categories:
        return True
    if len(reader.categories) >= CATEGORIES_MAX:
        return False
    reader.categories.add(category)
    return True


def _identity_of(reader: _Reader, row: Row) -> tuple[str, ...]:
    by_id = bool(reader.bank_id) and bool(row.cells[reader.bank_id[0][1]].strip())
    places = reader.bank_id if by_id else reader.identity
    return tuple(f"{label}={settled(row.cells[at])}" for label, at in places if row.cells[at].strip())
