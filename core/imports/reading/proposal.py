"""Proposes how a table is to be read: which formats fit it, and a mapping to begin with.

A format that fits gives its mapping outright. Where none does, roles are guessed from the words of the header,
and the date order and the decimal mark from whole columns. What the file as a whole can't say stays empty
and is named as a problem, for the person to choose.
"""

import collections.abc as abstract
import re
from typing import Final

import msgspec

from core.imports.reading.amounts import guess_decimal
from core.imports.reading.dates import guess_order, looks_like_date
from core.imports.reading.formats import Format
from core.imports.reading.mapping import (
    DateOrder,
    Decimal,
    Mapping,
    MappingFault,
    Positive,
    column_of,
    faults_of,
)
from core.imports.reading.names import canonical, header_text
from core.imports.reading.roles import DIRECTION_IN, DIRECTION_OUT, SPENDING, roles_in
from core.imports.reading.table import Table

#: Asked for instead of a format's id: read the table by its words alone.
NO_FORMAT: Final = ""

_NUMBERS: Final = ("amount", "in", "out", "balance")
_HAS_DIGIT: Final = re.compile(r"[0-9]")


class Proposal(msgspec.Struct, frozen=True):
    """A way to read a table.

    `format` is the id that was taken, None for none; `fitting` are all ids whose header this is, the one
    that asks for most names first; `problems` is what still keeps the mapping from being used.
    """

    format: str | None
    fitting: tuple[str, ...]
    mapping: Mapping
    problems: tuple[MappingFault, ...]


def propose(table: Table, formats: abstract.Mapping[str, Format], wanted: str | None = None) -> Proposal:
    """How `table` may be read. `wanted` names a format of `formats`, or NO_FORMAT; None takes the best."""
    fitting = fitting_formats(table.columns, formats)
    best = fitting[0].id if fitting else None
    chosen = best if wanted is None else (wanted or None)
    mapping = _by_words(table) if chosen is None else mapping_of(formats[chosen], table.columns)
    if chosen is not None and mapping.date_format is None and mapping.date is not None:
        order = guess_order(_cells(table, {"date": table.columns.index(mapping.date)})["date"])
        mapping = msgspec.structs.replace(mapping, date_format=order)
    return Proposal(chosen, tuple(form.id for form in fitting), mapping, faults_of(mapping, table.columns))


def fitting_formats(columns: tuple[str, ...], formats: abstract.Mapping[str, Format]) -> list[Format]:
    """All formats whose header this is, the one that asks for most names first."""
    names = frozenset(canonical(column) for column in columns)
    fitting = (form for form in formats.values() if form.fits(names))
    return sorted(fitting, key=lambda form: -len(form.header.required))


def mapping_of(format_: Format, columns: tuple[str, ...]) -> Mapping:
    """The mapping a format makes of these columns: for each role the first of its names that is there."""
    by_name = {canonical(column): column for column in reversed(columns)}
    roles = {
        role: by_name[canonical(name)]
        for role, accepted in format_.columns.items()
        for name in reversed(accepted)
        if canonical(name) in by_name
    }
    return _mapping(
        roles, format_.date.order, format_.amount.decimal, format_.amount.positive, format_.currency
    )


def guessed_anew(table: Table, before: Mapping, now: Mapping, chosen: abstract.Container[str]) -> Mapping:
    """`now`, with what nobody has chosen guessed from the columns that play another role than `before`.

    `chosen` names the fields of a mapping that a person has set; a decimal mark guessed from one column says
    nothing of another.
    """
    changes: dict[str, DateOrder | Decimal | None] = {}
    indices = {
        role: table.columns.index(column)
        for role in ("date", *_NUMBERS)
        if (column := column_of(now, role)) in table.columns
    }
    new = {role for role in indices if column_of(now, role) != column_of(before, role)}
    order = "date" in new and "date_format" not in chosen
    mark = not new.isdisjoint(_NUMBERS) and "decimal" not in chosen
    if not order and not mark:
        return now
    cells = _cells(table, indices)
    if order:
        changes["date_format"] = guess_order(cells["date"])
    if mark:
        changes["decimal"] = guess_decimal(
            [cell for role in _NUMBERS if role in indices for cell in cells[role]]
        )
    return msgspec.structs.replace(now, **changes)


def _mapping(
    roles: dict[str, str], order: DateOrder | None, decimal: Decimal, positive: Positive, currency: str | None
) -> Mapping:
    rest = {"date_format": order, "decimal": decimal, "positive": positive, "currency_code": currency}
    return msgspec.convert({**roles, **rest}, Mapping)


def _by_words(table: Table) -> Mapping:
    indices = roles_in([header_text(column) for column in table.columns])
    if "date" not in indices:
        indices |= _column_of_dates(table)
    cells = _cells(table, indices)
    if "in" in indices or "out" in indices:
        indices.pop("amount", None)
        indices.pop("direction", None)
    if not _says_direction(cells.get("direction", [])):
        indices.pop("direction", None)
    numbers = [cell for role in _NUMBERS if role in indices for cell in cells[role]]
    roles = {role: table.columns[index] for role, index in indices.items()}
    order = guess_order(cells.get("date", []))
    return _mapping(roles, order, guess_decimal(numbers), _meaning(roles.get("amount")), None)


def _column_of_dates(table: Table) -> dict[str, int]:
    """The first column in which more than half of all rows have a date; for tables without a header."""
    hits = [0] * len(table.columns)
    count = 0
    for row in table.rows():
        count += 1
        for index, cell in enumerate(row.cells):
            hits[index] += looks_like_date(cell)
    return next(({"date": index} for index, hit in enumerate(hits) if hit * 2 > count), {})


def _cells(table: Table, indices: dict[str, int]) -> dict[str, list[str]]:
    """The filled cells of each role, from rows whose date has a digit in it: totals and notes have none."""
    cells: dict[str, list[str]] = {role: [] for role in indices}
    dated = indices.get("date")
    for row in table.rows():
        if dated is not None and _HAS_DIGIT.search(row.cells[dated]):
            for role, index in indices.items():
                if row.cells[index].strip():
                    cells[role].append(row.cells[index])
    return cells


def _says_direction(cells: list[str]) -> bool:
    return bool(cells) and all(canonical(cell) in DIRECTION_IN | DIRECTION_OUT for cell in cells)


def _meaning(column: str | None) -> Positive:
    spends = column is not None and re.sub(r"\([^()]*\)$", "", header_text(column)) in SPENDING
    return Positive.OUT if spends else Positive.IN
