"""Dates as banks write them: one order for the whole file, every separator, a time behind it if they like.

Three orders of year, month and day are all there are, so a mapping names an order and not a pattern with
percent signs; a person can choose between three. The order is worked out from the whole column: a value over
12 or a year of four digits decides, and where nothing decides nobody guesses. A spreadsheet's serial number
(45000.5) can't be mistaken for any of them and is understood in every order.
"""

import datetime as dt
import re
import unicodedata
from collections.abc import Iterable
from typing import Final

from core.imports.reading.candidates import Refusal
from core.imports.reading.mapping import DateOrder

DATE_CHARACTERS_MAX: Final = 60
YEAR_MIN: Final = 1970
YEAR_MAX: Final = 2100
_CENTURY_TURN: Final = 70

_SEPARATOR: Final = r"\s*[-./년월年月]\s*"
_TIME: Final = (
    r"(?:(?:\s*T\s*|[\s,]+)?(?:\([월화수목금토일]\)\s*)?(?:(?:오전|오후|[AaPp]\.?[Mm]\.?)\s*)?"
    r"[0-9]{1,2}[:시]\s?[0-9]{1,2}(?:[:분]\s?[0-9]{1,2}(?:[.,][0-9]{1,9})?초?)?분?"
    r"(?:\s*[AaPp]\.?[Mm]\.?)?\s*(?:Z|UTC|KST|[-+][0-9]{2}:?[0-9]{2})?)?"
)
_TRIPLE: Final = re.compile(
    rf"([0-9]{{1,4}}){_SEPARATOR}([0-9]{{1,2}}){_SEPARATOR}([0-9]{{1,4}})[.일日]?(?:\s*\([월화수목금토일]\))?{_TIME}"
)
_COMPACT: Final = re.compile(r"([0-9]{4})([0-9]{2})([0-9]{2})(?:[\sT]?[0-9]{6}|[\sT][0-9:]{4,8})?")
_SERIAL: Final = re.compile(r"([2-7][0-9]{4})(?:\.[0-9]+)?")
_PAIR: Final = re.compile(rf"[0-9]{{1,2}}{_SEPARATOR}[0-9]{{1,2}}[일日.]?{_TIME}")
_SERIAL_ORIGIN: Final = dt.date(1899, 12, 30)

_PLACES: Final = {DateOrder.YMD: (0, 1, 2), DateOrder.MDY: (2, 0, 1), DateOrder.DMY: (2, 1, 0)}


def parse_date(text: str, order: DateOrder) -> str | Refusal:
    """The day in a cell as `YYYY-MM-DD`, or why there is none. The time behind it is not looked at."""
    plain = _plain(text)
    if not plain:
        return Refusal.NO_DATE
    if serial := _SERIAL.fullmatch(plain):
        return (_SERIAL_ORIGIN + dt.timedelta(days=int(serial[1]))).isoformat()
    if compact := _COMPACT.fullmatch(plain):
        return _day(int(compact[1]), int(compact[2]), int(compact[3]))
    triple = _TRIPLE.fullmatch(plain)
    if triple is None:
        return Refusal.NO_YEAR if _PAIR.fullmatch(plain) else Refusal.BAD_DATE
    year, month, day = (triple[place + 1] for place in _PLACES[order])
    if len(year) not in {2, 4} or len(day) > 2:
        return Refusal.BAD_DATE
    return _day(_full_year(year), int(month), int(day))


def looks_like_date(text: str) -> bool:
    """Whether a cell holds a date in any order; a bare number is none, though a serial could be one."""
    plain = _plain(text)
    if _TRIPLE.fullmatch(plain):
        return True
    compact = _COMPACT.fullmatch(plain)
    return compact is not None and isinstance(_day(int(compact[1]), int(compact[2]), int(compact[3])), str)


def guess_order(cells: Iterable[str]) -> DateOrder | None:
    """The one order in which every date of the column can be meant, or None if that isn't exactly one."""
    possible = set(DateOrder)
    same_in_every_order = triples = False
    for cell in set(cells):
        plain = _plain(cell)
        if _COMPACT.fullmatch(plain) or _SERIAL.fullmatch(plain):
            same_in_every_order = True
        elif triple := _TRIPLE.fullmatch(plain):
            triples = True
            possible &= {order for order in DateOrder if _can_be(triple, order)}
    if not triples:
        return DateOrder.YMD if same_in_every_order else None
    return possible.pop() if len(possible) == 1 else None


def _can_be(triple: re.Match[str], order: DateOrder) -> bool:
    year, month, day = (triple[place + 1] for place in _PLACES[order])
    return (
        len(year) in {2, 4}
        and len(month) <= 2
        and len(day) <= 2
        and 1 <= int(month) <= 12
        and 1 <= int(day) <= 31
    )


def _plain(text: str) -> str:
    plain = unicodedata.normalize("NFKC", text).strip()
    return plain if len(plain) <= DATE_CHARACTERS_MAX else "?"


def _full_year(year: str) -> int:
    if len(year) == 4:
        return int(year)
    return int(year) + (2000 if int(year) < _CENTURY_TURN else 1900)


def _day(year: int, month: int, day: int) -> str | Refusal:
    try:
        date = dt.date(year, month, day)
    except ValueError:
        return Refusal.NO_SUCH_DATE
    return date.isoformat() if YEAR_MIN <= year <= YEAR_MAX else Refusal.NO_SUCH_DATE
