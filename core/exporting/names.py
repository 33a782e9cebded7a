"""What accounts and currencies are called in plain-text ledgers, which allow less in a name than a household does.

Pure. Beancount and hledger share one set of names, so that somebody who tries both can compare them line by line: the root is
the account's type, the rest its name with everything but letters, digits and hyphens made a hyphen; Korean stays Korean. Where
two accounts would be called alike, both carry their currency, and where that does not tell them apart, a piece of the hash of
their ids: what an account is called then depends on nothing but the accounts there are, and not on their order. Nothing is lost
by it: the id and the name as they are stand beside it.
"""

import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from hashlib import sha256
from types import MappingProxyType
from typing import Final

import msgspec

from core.ledger.accounts import Account, AccountType

ROOTS: Final = MappingProxyType(
    {
        AccountType.ASSET: "Assets",
        AccountType.LIABILITY: "Liabilities",
        AccountType.EQUITY: "Equity",
        AccountType.INCOME: "Income",
        AccountType.EXPENSE: "Expenses",
    }
)
CHARACTERS_MAX: Final = 80
_HASH_CHARACTERS: Final = 8
_FIRST: Final = frozenset({"Lu", "Nd"})  # categories of Unicode


class Names(msgspec.Struct, frozen=True):
    """The names by which accounts (by their ids) and currencies (by their codes) are written."""

    accounts: Mapping[str, str]
    currencies: Mapping[str, str]


def names_of(accounts: Iterable[Account]) -> Names:
    """Return what these accounts and their currencies are called."""
    listed = list(accounts)
    return Names(_of_accounts(listed), _of_currencies({account.currency for account in listed}))


def _of_accounts(accounts: list[Account]) -> dict[str, str]:
    forms: tuple[Callable[[Account], str], ...] = (
        lambda one: _part(one.name) or _part(one.id) or _digest(one.id),
        lambda one: "-".join(filter(None, (_part(one.name), _part(one.currency)))),
        lambda one: "-".join(filter(None, (_part(one.name), _digest(one.id)))),
        lambda one: _digest(one.id, 40),
    )
    told: dict[str, str] = {}
    left = accounts
    for form in forms:
        tried = {one.id: f"{ROOTS[one.type]}:{form(one)}" for one in left}
        times = Counter([*tried.values(), *told.values()])
        told.update({name: text for name, text in tried.items() if times[text] == 1})
        left = [one for one in left if one.id not in told]
    assert not left, "two ids have one hash"
    return told


def _of_currencies(codes: set[str]) -> dict[str, str]:
    """Return codes that end with a letter or a digit, as both programs want them."""
    told: dict[str, str] = {}
    for code in sorted(codes, key=lambda code: (not code[-1].isalnum(), code)):
        name = code if code[-1].isalnum() else f"{code[:15]}{_digest(code)}"
        assert name not in told.values(), "two codes have one hash"
        told[code] = name
    return told


def _part(text: str) -> str:
    """Return a name as one part of an account's name; empty where nothing of it may stand there."""
    kept = "".join(one if _may_stand(one) else "-" for one in unicodedata.normalize("NFC", text))
    joined = "-".join(filter(None, kept.split("-")))[:CHARACTERS_MAX].rstrip("-")
    capital = joined[:1].upper()[:1]
    if not joined or unicodedata.category(capital) in _FIRST:
        return capital + joined[1:]
    return f"X-{joined}"  # Beancount begins a part with a capital or a digit, and Korean has no capitals


def _may_stand(one: str) -> bool:
    category = unicodedata.category(one)
    return category[0] == "L" or category == "Nd"


def _digest(text: str, characters: int = _HASH_CHARACTERS) -> str:
    return f"X{sha256(text.encode()).hexdigest()[:characters].upper()}"
