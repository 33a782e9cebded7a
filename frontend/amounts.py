"""Amounts as people write them: 12,000원 and $1,234.50 out of plain decimal strings, and back again.

Everything here works on the digits of a string. A float would change what it shows, and a table of decimal places
would be a second opinion beside the ledger's own: the ledger gives each amount with exactly the digits of its
currency, and this room only groups them. The browser has a twin (`static/amounts.js`); one list of cases holds
both (`tests/unit/frontend/amount_cases.json`). A locale library was not chosen: it would know two hundred
languages and still need to be told that a household says 원 and not ₩.
"""

import re
import unicodedata
from types import MappingProxyType
from typing import Final

from frontend.render import Language

TYPED_CHARACTERS_MAX: Final = 60
MINUS: Final = "−"  # U+2212, as wide as the plus; a hyphen hangs too low beside digits
# Above this many decimal places nobody reads the zeros: fund shares are kept with six.
PLAIN_DIGITS_MAX: Final = 4

_BEFORE: Final = MappingProxyType(
    {
        "AUD": "A$",
        "CAD": "C$",
        "CNY": "CN¥",
        "EUR": "€",
        "GBP": "£",
        "HKD": "HK$",
        "INR": "₹",
        "JPY": "¥",
        "KRW": "₩",
        "NZD": "NZ$",
        "PHP": "₱",
        "SGD": "S$",
        "THB": "฿",
        "TWD": "NT$",
        "USD": "$",
        "VND": "₫",
    }
)
_AFTER_KOREAN: Final = MappingProxyType({"KRW": "원", "JPY": "엔"})
_DECORATION: Final = re.compile(r"[\s_'’원엔$€£¥₩₹₱฿₫]")
_GROUPED: Final = re.compile(r"[0-9]{1,3}(,[0-9]{3})+(\.[0-9]+)?")
_PLAIN: Final = re.compile(r"[0-9]+(\.[0-9]*)?|\.[0-9]+")


def show_amount(amount: str, currency: str, lang: Language, *, signed: bool = False) -> str:
    """Return a decimal string of the ledger in the currency's own way.

    `signed` puts a plus before what is above zero, where a minus would mean the opposite direction.
    """
    sign = MINUS if amount.startswith("-") else "+" if signed and amount.strip("0.") else ""
    whole, _, fraction = amount.lstrip("-").partition(".")
    if len(fraction) > PLAIN_DIGITS_MAX:
        fraction = fraction.rstrip("0")
    digits = group_digits(f"{whole}.{fraction}" if fraction else whole)
    if lang == "ko" and currency in _AFTER_KOREAN:
        return f"{sign}{digits}{_AFTER_KOREAN[currency]}"
    if currency in _BEFORE:
        return f"{sign}{_BEFORE[currency]}{digits}"
    return f"{sign}{digits}\N{NO-BREAK SPACE}{currency}"


def group_digits(amount: str) -> str:
    """Return an unsigned decimal string with a comma before each three digits of its whole part."""
    whole, _, fraction = amount.partition(".")
    first = len(whole) % 3
    parts = [whole[:first]] if first else []
    parts += [whole[at : at + 3] for at in range(first, len(whole), 3)]
    return ",".join(parts) + (f".{fraction}" if fraction else "")


def show_count(number: int) -> str:
    """Return how many there are of something."""
    return group_digits(str(number))


def read_amount(typed: str) -> str | None:
    """Return what somebody typed as an unsigned decimal string, None if it is no amount.

    Commas count only where they group by three: "1,5" could be one and a half or fifteen, and is asked again.
    """
    if len(typed) > TYPED_CHARACTERS_MAX:
        return None
    text = _DECORATION.sub("", unicodedata.normalize("NFKC", typed))
    if _GROUPED.fullmatch(text):
        text = text.replace(",", "")
    if not text.isascii() or _PLAIN.fullmatch(text) is None:
        return None
    whole, _, fraction = text.partition(".")
    whole = whole.lstrip("0") or "0"
    return f"{whole}.{fraction}" if fraction else whole
