"""What a journal wishes of the ledger: which accounts to open and what to book, or why a transaction is not taken.

Pure. What reads the journal is its own program (hledger, Beancount); here its transactions become bodies of the API. An account
holds one currency, so a name that is used with three becomes three accounts. What a transaction exchanges (a cost, a price) goes
through an account of exchange for each currency: whatever its lines leave over there stands on it, and nothing is computed that
the journal does not say. A transaction that is not taken never stops the others.
"""

import re
import unicodedata
from collections.abc import Iterable, Mapping
from decimal import Decimal
from hashlib import sha256
from types import MappingProxyType
from typing import Any, Final

import msgspec

KINDS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "assets": "asset", "asset": "asset", "자산": "asset",
        "liabilities": "liability", "liability": "liability", "부채": "liability",
        "equity": "equity", "자본": "equity",
        "income": "income", "revenues": "income", "revenue": "income", "수익": "income", "수입": "income",
        "expenses": "expense", "expense": "expense", "비용": "expense", "지출": "expense",
    }
)  # fmt: skip
SYMBOLS: Final[Mapping[str, str]] = MappingProxyType(
    {"$": "USD", "€": "EUR", "£": "GBP", "¥": "JPY", "₩": "KRW", "원": "KRW", "₹": "INR"}
)
EXCHANGE: Final = "Exchange"
NAME_CHARACTERS_MAX: Final = 200
ID_CHARACTERS_MAX: Final = 100
_CURRENCY: Final = re.compile(r"[A-Z][A-Z0-9._'-]{0,23}")
_ID_PART: Final = re.compile(r"[^a-z0-9]+")
_DIGEST_CHARACTERS: Final = 12


class Line(msgspec.Struct, frozen=True):
    """One line as the journal's program tells it: the amount is a decimal string."""

    account: str
    amount: str
    currency: str


class Told(msgspec.Struct, frozen=True):
    """A transaction as the journal's program tells it; `line`: where it stands. `fault`: why it can't be taken, a code."""

    line: int
    date: str
    description: str
    tags: tuple[str, ...]
    lines: tuple[Line, ...]
    fault: str = ""


class NotTaken(msgspec.Struct, frozen=True):
    """A transaction that is not booked: where it stands, and why (a code of the catalogue, with what it names)."""

    line: int
    why: str
    what: str = ""


class Wishes(msgspec.Struct, frozen=True):
    """Bodies of the API: accounts by their ids, and transactions with the lines on which they stand."""

    accounts: dict[str, dict[str, Any]]
    transactions: list[tuple[int, dict[str, Any]]]
    not_taken: list[NotTaken]


def wishes_of(told: Iterable[Told], kinds: Mapping[str, str]) -> Wishes:
    """Return what a journal wishes. `kinds`: the kind of an account by its first part, in lower case, beside `KINDS`."""
    made = Wishes({}, [], [])
    known = {**KINDS, **kinds}
    for one in told:
        fault = _take(one, known, made)
        if fault is not None:
            made.not_taken.append(fault)
    return made


def _take(one: Told, kinds: Mapping[str, str], made: Wishes) -> NotTaken | None:
    if one.fault:
        return NotTaken(one.line, one.fault)
    lines = [line for line in one.lines if Decimal(line.amount)]
    if not lines:
        return NotTaken(one.line, "nothing")
    accounts: dict[str, dict[str, Any]] = {}
    postings: list[dict[str, str]] = []
    left: dict[str, Decimal] = {}
    for line in lines:
        currency = SYMBOLS.get(line.currency, line.currency.upper())
        if _CURRENCY.fullmatch(currency) is None:
            return NotTaken(one.line, "currency", line.currency)
        root, _, rest = line.account.partition(":")
        kind = kinds.get(root.strip().casefold())
        if kind is None:
            return NotTaken(one.line, "kind", root)
        body = _account(kind, rest or root, currency)
        accounts[body["id"]] = body
        postings.append({"account": body["id"], "amount": _plain(line.amount), "currency": currency})
        left[currency] = left.get(currency, Decimal(0)) + Decimal(line.amount)
    for currency, over in left.items():
        if over:
            body = _account("equity", EXCHANGE, currency)
            accounts[body["id"]] = body
            postings.append({"account": body["id"], "amount": _plain(str(-over)), "currency": currency})
    made.accounts.update(accounts)
    made.transactions.append(
        (
            one.line,
            {"date": one.date, "description": one.description, "tags": list(one.tags), "postings": postings},
        )
    )
    return None


def _account(kind: str, rest: str, currency: str) -> dict[str, Any]:
    """Return the body that opens an account; its id follows from its kind, name and currency alone."""
    parts = [unicodedata.normalize("NFC", part.strip()) for part in rest.split(":")]
    name = " · ".join(part for part in parts if part)[:NAME_CHARACTERS_MAX]
    slug = ":".join(_ID_PART.sub("-", part.lower()).strip("-") for part in parts)
    plain = all(part.isascii() and _ID_PART.sub("-", part.lower()).strip("-") for part in parts)
    if not plain or len(slug) > ID_CHARACTERS_MAX:
        slug = sha256(f"{kind}\0{rest}".encode()).hexdigest()[:_DIGEST_CHARACTERS]
    code = re.sub(r"[^a-z0-9_-]", "-", currency.lower())
    return {"id": f"{kind}:{slug}:{code}", "name": name, "type": kind, "currency": currency}


def _plain(amount: str) -> str:
    """Return a decimal without exponent, plus sign or empty zeros behind the point."""
    text = f"{Decimal(amount):f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
