"""Numbers as banks write them, without ever guessing from one cell.

The decimal mark comes from the mapping and holds for the whole file, so `1,234` can't be one and a quarter in
one row and a thousand in the next. Thousands have to stand in threes. What carries more digits than its
currency has is refused, because rounding would make another amount of it; only `.0` and `.00` behind a
currency without cents are taken for the noise of a spreadsheet, while `1.000` may have meant a thousand.
"""

import re
import unicodedata
from collections import Counter
from typing import Final

import msgspec

from core.imports.reading.candidates import Refusal
from core.imports.reading.mapping import Decimal
from core.ledger.money import AMOUNT_CHARACTERS_MAX, digits_of, fits

_SIGNS: Final = str.maketrans(dict.fromkeys("−‐‑‒–—△▲", "-"))
_MONEY: Final = r"(?:₩|\$|€|£|¥|円|원|[A-Za-z]{3}(?![A-Za-z]))?"
_SHAPE: Final = re.compile(
    rf"(?P<open>\()?\s*(?P<first>[-+])?\s*{_MONEY}\s*(?P<second>[-+])?\s*"
    rf"(?P<number>[0-9.,'\s]*[0-9][0-9.,'\s]*?)\s*{_MONEY}\s*(?P<last>-)?\s*{_MONEY}\s*(?P<close>\))?"
)
_EXPONENT: Final = re.compile(r"[-+]?[0-9]+([.,][0-9]+)?[eE][-+]?[0-9]+")
_POINT: Final = re.compile(
    r"(?P<whole>[0-9]*|[0-9]{1,3}(?:(?P<mark>[,'\s])[0-9]{3})(?:(?P=mark)[0-9]{3})*)(?:\.(?P<part>[0-9]+))?"
)
_COMMA: Final = re.compile(
    r"(?P<whole>[0-9]*|[0-9]{1,3}(?:(?P<mark>[.'\s])[0-9]{3})(?:(?P=mark)[0-9]{3})*)(?:,(?P<part>[0-9]+))?"
)
_NOISE_DIGITS_MAX: Final = 2
_ANY_DIGIT: Final = str.maketrans("123456789", "000000000")


class Number(msgspec.Struct, frozen=True):
    """A number as it was written. `signed` tells whether a sign stood there at all."""

    negative: bool
    signed: bool
    whole: str
    part: str

    @property
    def is_zero(self) -> bool:
        """Whether it is nought, however it was written."""
        return not (self.whole + self.part).strip("0")


def parse_number(text: str, decimal: Decimal) -> Number | Refusal:
    """The number in a cell that isn't blank, or why there is none."""
    plain = unicodedata.normalize("NFKC", text).translate(_SIGNS).strip()
    if len(plain) > AMOUNT_CHARACTERS_MAX:
        return Refusal.BAD_AMOUNT
    if _EXPONENT.fullmatch(plain):
        return Refusal.EXPONENT
    shape = _SHAPE.fullmatch(plain)
    if shape is None or (shape["open"] is None) != (shape["close"] is None):
        return Refusal.BAD_AMOUNT
    signs = [sign for sign in (shape["first"], shape["second"], shape["last"]) if sign]
    if len(signs) + (shape["open"] is not None) > 1:
        return Refusal.BAD_AMOUNT
    digits = (_POINT if decimal is Decimal.POINT else _COMMA).fullmatch(shape["number"])
    if digits is None:
        return Refusal.BAD_AMOUNT
    negative = shape["open"] is not None or "-" in signs
    return Number(
        negative=negative,
        signed=negative or bool(signs),
        whole="".join(filter(str.isdigit, digits["whole"])),
        part=digits["part"] or "",
    )


def to_minor(number: Number, currency: str) -> int | Refusal:
    """The number in minor units of `currency`, with its sign; never rounded."""
    digits = digits_of(currency)
    part = number.part
    if len(part) > digits and len(part) <= _NOISE_DIGITS_MAX:
        part = part[:digits] if not part[digits:].strip("0") else part
    if len(part) > digits:
        return Refusal.TOO_MANY_DIGITS
    minor = int((number.whole or "0") + part.ljust(digits, "0"))
    minor = -minor if number.negative else minor
    return minor if fits(minor) else Refusal.OUT_OF_RANGE


def guess_decimal(cells: list[str]) -> Decimal:
    """The decimal mark of a whole column: a comma only if cells need it and none needs the point.

    Where every cell reads both ways (`1.000`), the point is taken: a currency of two digits then refuses
    three of them, and nothing is booked wrongly.
    """
    # How a cell reads is a matter of where its digits stand and not of which they are: a column has few shapes.
    shapes = Counter(cell.translate(_ANY_DIGIT) for cell in cells)
    point = sum(count for shape, count in shapes.items() if _reads(shape, Decimal.POINT))
    comma = sum(count for shape, count in shapes.items() if _reads(shape, Decimal.COMMA))
    return Decimal.COMMA if comma > point else Decimal.POINT


def _reads(cell: str, decimal: Decimal) -> bool:
    number = parse_number(cell, decimal)
    return isinstance(number, Number) and len(number.part) <= _NOISE_DIGITS_MAX
