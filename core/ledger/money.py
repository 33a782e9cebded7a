"""Money: decimal strings outside, whole numbers of minor units inside.

An amount is a signed 64-bit count of the smallest unit of its currency: won, cents, fils. How many digits a
currency has is ISO 4217's business and is kept here as data that only grows: changing an exponent would give
every stored amount another value. Codes outside ISO 4217 (a share, a fund, vacation hours, a voucher) are
currencies too, because a household keeps them in the same book; they all have six digits, enough for fund
shares and small enough that nine trillion of them still fit. A table of exponents per code of our own was not
chosen: two books would then disagree about what the same number means. Floats are never accepted: 0.1 has no
exact float, and a reader could not tell what was meant.
"""

import re
from functools import lru_cache
from types import MappingProxyType
from typing import Final

from core.ledger.reasons import Reason

INT64_MAX: Final = 2**63 - 1
INT64_MIN: Final = -(2**63)
AMOUNT_CHARACTERS_MAX: Final = 40
OTHER_DIGITS: Final = 6
KNOWN_MAX: Final = (
    4_096  # amounts that are remembered; none is longer than AMOUNT_CHARACTERS_MAX once it is one
)

_ISO_4217: Final[dict[int, str]] = {
    0: "BIF BYR CLP DJF GNF ISK JPY KMF KRW PYG RWF UGX UYI VND VUV XAF XOF XPF",
    2: (
        "AED AFN ALL AMD ANG AOA ARS AUD AWG AZN BAM BBD BDT BGN BMD BND BOB BOV BRL BSD BTN BWP BYN BZD CAD "
        "CDF CHE CHF CHW CNY COP COU CRC CUC CUP CVE CZK DKK DOP DZD EEK EGP ERN ETB EUR FJD FKP GBP GEL GHS "
        "GIP GMD GTQ GYD HKD HNL HRK HTG HUF IDR ILS INR IRR JMD KES KGS KHR KPW KYD KZT LAK LBP LKR LRD LSL "
        "LTL LVL MAD MDL MGA MKD MMK MNT MOP MRO MRU MUR MVR MWK MXN MXV MYR MZN NAD NGN NIO NOK NPR NZD PAB "
        "PEN PGK PHP PKR PLN QAR RON RSD RUB SAR SBD SCR SDG SEK SGD SHP SLE SLL SOS SRD SSP STD STN SVC SYP "
        "SZL THB TJS TMT TOP TRY TTD TWD TZS UAH USD USN UYU UZS VED VEF VES WST XCD XCG YER ZAR ZMW ZWG ZWL"
    ),
    3: "BHD IQD JOD KWD LYD OMR TND",
    4: "CLF UYW",
}
ISO_4217_DIGITS: Final = MappingProxyType(
    {code: digits for digits, codes in _ISO_4217.items() for code in codes.split()}
)

_CODE: Final = re.compile(r"[A-Z][A-Z0-9._'-]{0,23}")
_AMOUNT: Final = re.compile(r"(-?)(0|[1-9][0-9]*)(?:\.([0-9]+))?")


def is_currency(code: str) -> bool:
    """Whether `code` may name a currency: an ISO 4217 code or one of the household's own."""
    return _CODE.fullmatch(code) is not None


def digits_of(code: str) -> int:
    """Return how many decimal digits the currency has."""
    return ISO_4217_DIGITS.get(code, OTHER_DIGITS)


@lru_cache(maxsize=KNOWN_MAX)
def parse_amount(text: str, code: str) -> int | Reason:
    """Return `text` in minor units of `code`, or why it is no amount of that currency.

    What was read last is remembered: one event is read by whoever decides, follows, tells and proves it. Fewer digits than the currency has are fine ("12" dollars); more are refused, also when they are zeros,
    because nobody can have meant them.
    """
    if len(text) > AMOUNT_CHARACTERS_MAX:
        return Reason.TOO_LONG
    match = _AMOUNT.fullmatch(text)
    if match is None:
        return Reason.MALFORMED
    sign, whole, fraction = match.group(1), match.group(2), match.group(3) or ""
    digits = digits_of(code)
    if len(fraction) > digits:
        return Reason.TOO_MANY_DIGITS
    minor = int(whole + fraction.ljust(digits, "0"))
    minor = -minor if sign else minor
    return minor if fits(minor) else Reason.OUT_OF_RANGE


def amount_fault(text: str) -> Reason | None:
    """Say why `text` is no amount of any currency; how many digits it may have is the currency's to say."""
    if len(text) > AMOUNT_CHARACTERS_MAX:
        return Reason.TOO_LONG
    return None if _AMOUNT.fullmatch(text) else Reason.MALFORMED


def is_zero(text: str) -> bool:
    """Whether a well-formed amount is nothing in any currency."""
    return not text.strip("-0.")


def shortest(text: str) -> str:
    """Return a well-formed amount as briefly as it can be written: "12.50" as "12.5", "-0" as "0"."""
    whole, _, fraction = text.partition(".")
    fraction = fraction.rstrip("0")
    brief = f"{whole}.{fraction}" if fraction else whole
    return "0" if is_zero(brief) else brief


def format_amount(minor: int, code: str) -> str:
    """Return minor units as a decimal string with exactly the digits of the currency."""
    digits = digits_of(code)
    sign = "-" if minor < 0 else ""
    text = str(abs(minor)).rjust(digits + 1, "0")
    return f"{sign}{text[:-digits]}.{text[-digits:]}" if digits else f"{sign}{text}"


def fits(minor: int) -> bool:
    """Whether the number fits the signed 64 bits of a stored amount."""
    return INT64_MIN <= minor <= INT64_MAX
