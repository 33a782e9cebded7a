"""The fingerprint of a bank's row: how the same purchase is known when it comes a second time.

Made of the account, the cells that no later export changes, and which of several identical rows it is:
two coffees on one day are two rows, and the same file again is the same two. The bytes of a cell differ
between a CSV and a workbook (`4,500` and `4500`, dots and dashes in a date), so plain numbers and dates are
first brought into one spelling. Parsed values were not chosen: another mapping would then make every row new.
"""

import hashlib
import re
import unicodedata
from typing import Final

import msgspec

from core.imports.reading.candidates import Candidate

FINGERPRINT_BYTES: Final = 16

_BEGINNINGS: Final = frozenset("0123456789+-")
_NUMBER: Final = re.compile(r"[-+]?[0-9]{1,3}(?:,[0-9]{3})+(?:\.[0-9]+)?|[-+]?[0-9]+(?:\.[0-9]+)?")
_NOUGHTS: Final = re.compile(r"(\.[0-9]*?)0+$")
_DATE: Final = re.compile(r"([0-9]{4})[-./]([0-9]{2})[-./]([0-9]{2})(?:[T\s]+(.*))?")


def fingerprint(account: str, candidate: Candidate) -> str:
    """32 hex digits that stand for this row of this account (the account's id), in every export of it."""
    words = msgspec.json.encode([account, candidate.identity, candidate.ordinal])
    return hashlib.sha256(words).digest()[:FINGERPRINT_BYTES].hex()


def settled(cell: str) -> str:
    """The spelling of a cell that every container agrees on."""
    text = " ".join(unicodedata.normalize("NFKC", cell).split())
    if text[:1] not in _BEGINNINGS:
        return text
    if _NUMBER.fullmatch(text):
        return _number(text.replace(",", "").removeprefix("+"))
    if date := _DATE.fullmatch(text):
        return " ".join(part for part in ("-".join(date.group(1, 2, 3)), date[4]) if part)
    return text


def _number(text: str) -> str:
    return _NOUGHTS.sub(r"\1", text).removesuffix(".") if "." in text else text
