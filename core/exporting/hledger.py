"""A book as hledger reads it: declared accounts and commodities, transactions, and assertions of all balances at the end.

Pure. Everything that is used is declared, so `hledger check --strict` passes, and the decimal mark is said once, because
"12.345" could be twelve thousand to a reader in another country. Ids and numbers stand as tags in comments. Source of the
syntax: hledger's journal manual, version 1.25 and later.
"""

import re
from collections.abc import Iterator
from typing import Final

from core.exporting.paper import Paper, one_line, waiting
from core.ledger.accounts import AccountType
from core.ledger.money import digits_of, format_amount
from core.ledger.views import TransactionView

_PLAIN: Final = re.compile(r"[A-Za-z]+")
_TYPES: Final = {
    AccountType.ASSET: "A",
    AccountType.LIABILITY: "L",
    AccountType.EQUITY: "E",
    AccountType.INCOME: "R",
    AccountType.EXPENSE: "X",
}


def head(paper: Paper) -> Iterator[str]:
    """Give what stands before the transactions."""
    yield f"; Everything that was booked up to record {paper.seq}.\n"
    yield "decimal-mark .\n\n"
    for code, name in sorted(paper.names.currencies.items()):
        yield f"commodity 1000.{'0' * digits_of(code)} {_symbol(name)}\n"
    yield "\n"
    for account in sorted(paper.accounts.values(), key=lambda one: paper.names.accounts[one.id]):
        name = paper.names.accounts[account.id]
        yield f"account {name}  ; type:{_TYPES[account.type]}, id:{_value(account.id)}, name:{_value(account.name)}\n"
    yield "\n"


def transaction(paper: Paper, seen: TransactionView, payment_method: str | None) -> Iterator[str]:
    """Give one transaction."""
    yield f"{seen.date} * {_description(seen.description)}\n"
    told = {
        "id": seen.id,
        "seq": str(seen.seq),
        "entry": seen.entry,
        "reverses": seen.reverses,
        "payment-method": payment_method,
        "tags": " ".join(seen.tags) or None,
    }
    yield f"    ; {', '.join(f'{key}:{_value(value)}' for key, value in told.items() if value is not None)}\n"
    for line in seen.postings:
        yield f"    {paper.names.accounts[line.account]}  {line.amount} {_symbol(paper.names.currencies[line.currency])}\n"
    yield "\n"


def foot(paper: Paper) -> Iterator[str]:
    """Give what waits, and the balances at the end as postings of nothing that assert them."""
    yield from waiting(paper)
    if paper.day_after is None or not paper.accounts:
        return
    yield f"{paper.day_after} * The balances after record {paper.seq}\n"
    for account in sorted(paper.accounts.values(), key=lambda one: paper.names.accounts[one.id]):
        symbol = _symbol(paper.names.currencies[account.currency])
        nothing, posted = (format_amount(amount, account.currency) for amount in (0, account.posted))
        yield f"    {paper.names.accounts[account.id]}  {nothing} {symbol} = {posted} {symbol}\n"


def _symbol(name: str) -> str:
    """Return a commodity as it stands beside an amount: in quotation marks where it is more than letters."""
    return name if _PLAIN.fullmatch(name) else f'"{name}"'


def _description(text: str) -> str:
    """Return a text that stands behind the date: a semicolon would begin a comment, a bar would end a payee."""
    said = one_line(text).replace(";", ",").replace("|", "/")
    # At the beginning, these would be a mark or a code.
    return f"'{said}" if said.startswith(("*", "!", "(")) else said


def _value(text: str) -> str:
    """Return the value of a tag, which a comma would end."""
    return one_line(text).replace(",", " ")
