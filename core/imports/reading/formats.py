"""What is known of a bank's export, as data: one TOML file for each layout, without any code in it.

A format is recognised by the names in its header and by nothing else; the name of a file and the position of
a column prove nothing. Each carries its own invented sample and what has to come of it, so that adding a bank
is adding one file, and one test runs them all. Patterns were left out of the language: names are compared
as they are, so a contributed file can't make an import hang.
"""

import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Final, Literal

import msgspec

from core.imports.reading.mapping import ROLES, DateOrder, Decimal, Positive
from core.imports.reading.names import canonical
from core.ledger.money import is_currency

SCHEMA: Final = 1
LANGUAGES: Final = frozenset({"ko", "en"})
SCAN_ROWS_MAX: Final = 60
_FOLDER: Final = Path(__file__).parents[1] / "formats"

Words = tuple[str, ...]


class Header(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the header row is known: all of `required`, none of `forbidden`, within the first `scan_rows`."""

    required: Words
    forbidden: Words = ()
    scan_rows: int = 40


class DateRule(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The order of year, month and day; absent where it depends on the account: then the whole file is asked, or a person."""

    order: DateOrder | None = None


class AmountRule(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The decimal mark, and what a positive number in the amount column means."""

    decimal: Decimal = Decimal.POINT
    positive: Positive = Positive.IN


class DirectionRule(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, rename={"inflow": "in", "outflow": "out"}
):
    """The words of the direction column."""

    inflow: Words
    outflow: Words


class StatusRule(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The words of the status column: booked, not yet booked, taken back. Any other stops the row."""

    booked: Words
    pending: Words = ()
    reverted: Words = ()


class Expected(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A row that the sample has to give; a field that isn't named isn't compared."""

    date: str
    amount: str
    currency: str
    description: str
    memo: str | None = None
    category: str | None = None
    payment_method: str | None = None
    balance: str | None = None


class Sample(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Invented rows as a CSV text, and what has to come of them."""

    input: str
    expect: tuple[Expected, ...]
    skipped: int = 0
    refused: int = 0
    balance_check: str = "absent"


class Format(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One layout of one bank. `identity` are the roles whose cells no later export changes.

    `bank_id` names the column of the bank's own id of a row: where it is filled, a row is known by it, its date and
    its amount, and by nothing that a later export might spell otherwise. `notes` are how the
    text of a row begins that has a date and no amount because it is no movement.
    """

    schema: int
    id: str
    name: dict[str, str]
    kind: Literal["account", "card-list", "ledger"]
    sure: Literal["A", "B", "C"]
    header: Header
    columns: dict[str, Words]
    date: DateRule
    identity: Words
    test: tuple[Sample, ...]
    currency: str | None = None
    amount: AmountRule = AmountRule()
    direction: DirectionRule | None = None
    status: StatusRule | None = None
    bank_id: Words = ()
    notes: Words = ()

    def fits(self, names: frozenset[str]) -> bool:
        """Whether a header with these canonical names is one of this layout."""
        wanted = {canonical(name) for name in self.header.required}
        unwanted = {canonical(name) for name in self.header.forbidden}
        return wanted <= names and not unwanted & names


def read_format(text: str, stem: str) -> Format | tuple[str, ...]:
    """The format in the text of a TOML file called `stem`, or one sentence for each fault."""
    try:
        made = msgspec.convert(tomllib.loads(text), Format)
    except (tomllib.TOMLDecodeError, msgspec.ValidationError) as fault:
        return (f"{stem}: {fault}.",)
    return tuple(f"{stem}: {fault}." for fault in _faults_of(made, stem)) or made


@cache
def builtin_formats() -> Mapping[str, Format]:
    """The formats that come with the program, by id. A broken one is our own bug."""
    made: dict[str, Format] = {}
    for file in sorted(_FOLDER.glob("*.toml")):
        format_ = read_format(file.read_text("utf-8"), file.stem)
        assert isinstance(format_, Format), format_
        made[format_.id] = format_
    return MappingProxyType(made)


def _faults_of(format_: Format, stem: str) -> Iterator[str]:
    if format_.schema != SCHEMA:
        yield f"schema {format_.schema} is not {SCHEMA}"
    if format_.id != stem:
        yield f"id {format_.id!r} is not the name of its file"
    if set(format_.name) != LANGUAGES:
        yield "name needs ko and en, and nothing else"
    if format_.currency is not None and not is_currency(format_.currency):
        yield f"{format_.currency!r} is no currency"
    if not format_.header.required:
        yield "header.required names nothing"
    if not 1 <= format_.header.scan_rows <= SCAN_ROWS_MAX:
        yield f"header.scan_rows must be 1 to {SCAN_ROWS_MAX}"
    if not format_.test:
        yield "there is no [[test]]"
    yield from _role_faults(format_)


def _role_faults(format_: Format) -> Iterator[str]:
    roles = set(format_.columns)
    yield from (f"columns.{role} is no role" for role in sorted(roles - set(ROLES)))
    yield from (f"columns.{role} names nothing" for role in sorted(roles) if not format_.columns[role])
    yield from (
        f"identity names {role!r}, which has no column" for role in format_.identity if role not in roles
    )
    if "date" not in roles:
        yield "columns.date is missing"
    if ("amount" in roles) == bool(roles & {"in", "out"}):
        yield "columns needs either amount, or in and out"
    if not format_.identity:
        yield "identity names nothing"
    if ("direction" in roles) != (format_.direction is not None):
        yield "columns.direction and [direction] need each other"
    if ("status" in roles) != (format_.status is not None):
        yield "columns.status and [status] need each other"
