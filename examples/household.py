"""A household's books in beancount, told to the ledger: accounts, balanced transactions, and what must come out.

`bean-example` makes the books, beancount's own loader reads them, beancount's own realization says what every
balance has to be; nothing of that is ours, so it can prove us wrong. One account of ours stands for each
account and commodity, because an account here holds one currency. A purchase or sale balances by price and not
by count: its two sides meet in accounts under equity:conversions, one per commodity, which then hold what was
exchanged in all.
"""

import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

from beancount import loader
from beancount.core import convert, data, realization

BEAN_EXAMPLE = Path(sys.executable).with_name("bean-example")
SEED = 7
#: Fixed days: without them the books would end today and be others tomorrow.
FIRST_DAY = "2014-01-01"
LAST_DAY = "2023-12-31"
LAST_DAY_OF_A_PART = "2014-12-31"
MAKING_S = 120.0
CONVERSIONS = "equity:conversions"
TYPES = {
    "assets": "asset",
    "liabilities": "liability",
    "equity": "equity",
    "income": "income",
    "expenses": "expense",
}


@dataclass(frozen=True, slots=True)
class Units:
    """So much of a commodity."""

    number: Decimal
    currency: str


@dataclass(frozen=True, slots=True)
class Wish:
    """One thing to be asked of the ledger: the body, the key it is asked under, the accounts it touches."""

    key: str
    body: dict[str, Any]
    accounts: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Household:
    """Books to be told, in their order, and the balances that must come out, by account."""

    accounts: tuple[Wish, ...]
    transactions: tuple[Wish, ...]
    balances: dict[str, Decimal]

    @property
    def commodities(self) -> int:
        """How many kinds of money and paper there are."""
        return len({wish.body["currency"] for wish in self.accounts})


def make_books(path: Path, last_day: str) -> None:
    """Have `bean-example` write the books up to a day. Raises CalledProcessError with what it said."""
    argv = [str(BEAN_EXAMPLE), "--seed", str(SEED), "--date-begin", FIRST_DAY, "--date-end", last_day]
    subprocess.run(
        [*argv, "--output", str(path)], check=True, capture_output=True, text=True, timeout=MAKING_S
    )


def read_books(path: Path) -> Household:
    """Return the books in a file."""
    entries, errors, _options = loader.load_file(str(path))
    assert not errors, f"beancount finds fault with its own example: {errors[0]}"
    booked = [entry for entry in entries if isinstance(entry, data.Transaction)]
    names = _names(booked)
    transactions = tuple(_transaction(number, entry, names) for number, entry in enumerate(booked, 1))
    currencies = {
        line["account"]: line["currency"] for wish in transactions for line in wish.body["postings"]
    }
    accounts = tuple(_account(name, currency) for name, currency in sorted(currencies.items()))
    return Household(accounts, transactions, _balances(booked, names))


def _names(booked: list[data.Transaction]) -> dict[tuple[str, str], str]:
    """Return our account for each of beancount's and each commodity in it.

    The commodity is named only where there are several: `assets:us:etrade:vht` needs no second `vht`.
    """
    commodities: dict[str, set[str]] = defaultdict(set)
    for entry in booked:
        for posting in entry.postings:
            commodities[posting.account].add(_units(posting).currency)
    names = {}
    for account, held in commodities.items():
        for commodity in held:
            suffix = f":{commodity.lower()}" if len(held) > 1 else ""
            names[account, commodity] = account.lower() + suffix
    assert len(set(names.values())) == len(names), "two accounts would share a name"
    return names


def _account(name: str, currency: str) -> Wish:
    kind = TYPES[name.partition(":")[0]]
    body = {"id": name, "name": name, "type": kind, "currency": currency}
    return Wish(f"household-{SEED}-open-{name}", body, (name,))


def _transaction(number: int, entry: data.Transaction, names: dict[tuple[str, str], str]) -> Wish:
    lines = [
        (names[posting.account, units.currency], units.number, units.currency)
        for posting in entry.postings
        for units in [_units(posting)]
    ]
    lines += _conversions(lines)
    body = {
        "date": entry.date.isoformat(),
        "description": ", ".join(filter(None, (entry.payee, entry.narration))),
        "tags": sorted(entry.tags or ()),
        "postings": [
            {"account": account, "amount": f"{number:f}", "currency": currency}
            for account, number, currency in lines
        ],
    }
    accounts = tuple(dict.fromkeys(account for account, _number, _currency in lines))
    return Wish(f"household-{SEED}-{number:05}", body, accounts)


def _units(posting: data.Posting) -> Units:
    """Return what a booked posting moves; only one that is not booked yet may leave it open."""
    assert posting.units is not None, "the loader books every posting"
    assert posting.units.number is not None, "as above"
    return Units(posting.units.number, posting.units.currency)


def _conversions(lines: list[tuple[str, Decimal, str]]) -> Iterator[tuple[str, Decimal, str]]:
    """Return the lines that make each currency add up to zero by itself."""
    sums: dict[str, Decimal] = defaultdict(Decimal)
    for _account_name, number, currency in lines:
        sums[currency] += number
    for currency, off in sums.items():
        if off:
            yield f"{CONVERSIONS}:{currency.lower()}", -off, currency


def _balances(booked: list[data.Transaction], names: dict[tuple[str, str], str]) -> dict[str, Decimal]:
    """Return beancount's own final balance of each account, in units, under our names."""
    balances = dict.fromkeys(names.values(), Decimal())
    root = realization.realize(booked)  # type: ignore[no-untyped-call]  # beancount is typed in part
    for real in realization.iter_children(root):  # type: ignore[no-untyped-call]  # as above
        for position in real.balance.reduce(convert.get_units):
            balances[names[real.account, position.units.currency]] = position.units.number
    return balances
