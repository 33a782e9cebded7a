"""Reads QIF: one row for each record of a bank, card or cash list, columns named in plain words.

The format says neither its encoding, nor its currency, nor the order of its dates; the first is found as for any text,
the other two are asked where the file leaves them open. A transfer (`[Savings]`) is no category, and a split is not
one category: both stay readable in columns of their own, and nothing is made up of them. Lists of securities,
categories and memorised payments in the same file hold no movement of money and are passed over.
"""

import re
from collections.abc import Iterator
from typing import Final

from core.imports.reading.raw import RawTable
from core.imports.reading.table import Row, Unreadable, Why

#: The columns; the first seven are what a mapping takes its words from.
COLUMNS: Final = (
    "Date",
    "Amount",
    "Payee",
    "Memo",
    "Category",
    "Transfer",
    "Split",
    "Number",
    "Cleared",
    "List",
)
_MARK: Final = re.compile(r"\s*!(?:Type|Account|Option|Clear)\b", re.IGNORECASE)
_MOVES: Final = frozenset({"bank", "ccard", "cash", "oth a", "oth l"})
_CODES: Final = {"D": "Date", "P": "Payee", "M": "Memo", "N": "Number", "C": "Cleared"}
_SPLIT: Final = frozenset("SE$%")
_LATER: Final = re.compile(r"\s*'\s*([0-9]{1,4})$")
_BLANKS: Final = re.compile(r"\s+")
_CENTURY: Final = 2_000
_YEAR_DIGITS: Final = 4


def is_qif(text: str) -> bool:
    """Whether a text is a QIF file, by how it begins."""
    return _MARK.match(text) is not None


def read_qif(text: str) -> RawTable | Unreadable:
    """The records of its lists of transactions, in order."""
    rows = tuple(_records(text.replace("\r\n", "\n").replace("\r", "\n")))
    return RawTable(None, (Row(1, COLUMNS), *rows)) if rows else Unreadable(Why.NO_TABLE)


def _records(text: str) -> Iterator[Row]:
    kind, begun = "", 0
    now: dict[str, str] = {}
    for number, line in enumerate(text.split("\n"), 1):
        if line.startswith("!"):
            kind, now = _kind_of(line, kind), {}
        elif line.startswith("^"):
            if now and kind in _MOVES:
                yield _row(begun, kind, now)
            now = {}
        elif line.strip():
            begun = begun if now else number
            _take(now, line[0].upper(), line[1:].strip())
    if now and kind in _MOVES:
        yield _row(begun, kind, now)


def _kind_of(line: str, before: str) -> str:
    word, _, rest = line[1:].partition(":")
    match word.strip().lower():
        case "type":
            return rest.strip().lower()
        case "option" | "clear":
            return before
        case _:
            return ""  # a list of accounts, or something newer


def _take(now: dict[str, str], code: str, value: str) -> None:
    if code in {"T", "U"}:
        now.setdefault("Amount", value)
    elif code == "L":
        transfer = value.startswith("[")
        now.setdefault("Transfer" if transfer else "Category", value.strip("[]") if transfer else value)
    elif code in _SPLIT:
        before = now.get("Split", "")
        mark = "; " if code == "S" else " "
        now["Split"] = before + mark + value if before else value
    elif code in _CODES:
        now.setdefault(_CODES[code], _date(value) if code == "D" else value)


def _row(line: int, kind: str, now: dict[str, str]) -> Row:
    settled = {**now, "List": kind}
    if "Split" in now:
        settled["Category"] = ""  # the first of several would speak for all
    return Row(line, tuple(settled.get(column, "") for column in COLUMNS))


def _date(text: str) -> str:
    """A date without the blanks some write for noughts; a year behind an apostrophe is one after 2000."""
    later = _LATER.search(text)
    if later is not None:
        year = later[1] if len(later[1]) == _YEAR_DIGITS else str(_CENTURY + int(later[1]))
        text = f"{text[: later.start()]}/{year}"
    return _BLANKS.sub("", text)
