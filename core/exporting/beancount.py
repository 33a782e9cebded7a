"""A book as Beancount reads it: open directives, transactions, and a balance assertion for each account at the end.

Pure. The assertions make `bean-check` a second opinion: it adds everything up by itself and says so where its balances are not
ours. What Beancount has no place for (ids, numbers, tags in Korean, ways of paying) stands as metadata. Source of the syntax:
the Beancount language syntax, version 3.
"""

import re
from collections.abc import Iterator
from typing import Final

from core.exporting.paper import Paper, one_line, waiting
from core.ledger.money import format_amount
from core.ledger.views import TransactionView

_TAG: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9/._-]*")


def head(paper: Paper) -> Iterator[str]:
    """Give what stands before the transactions."""
    yield f"; Everything that was booked up to record {paper.seq}.\n"
    yield 'option "title" "Fieldstack"\n\n'
    for account in sorted(paper.accounts.values(), key=lambda one: paper.names.accounts[one.id]):
        name, currency = paper.names.accounts[account.id], paper.names.currencies[account.currency]
        yield f"{paper.first_day} open {name} {currency}\n"
        yield _meta("id", account.id)
        yield _meta("name", account.name)
    yield "\n"


def transaction(paper: Paper, seen: TransactionView, payment_method: str | None) -> Iterator[str]:
    """Give one transaction."""
    tags = "".join(f" #{tag}" for tag in seen.tags if _TAG.fullmatch(tag))
    yield f"{seen.date} * {_text(seen.description)}{tags}\n"
    yield _meta("id", seen.id)
    yield f"  seq: {seen.seq}\n"
    others = [tag for tag in seen.tags if not _TAG.fullmatch(tag)]
    for key, value in (
        ("entry", seen.entry),
        ("reverses", seen.reverses),
        ("payment-method", payment_method),
        ("tags", ", ".join(others) or None),
    ):
        if value is not None:
            yield _meta(key, value)
    for line in seen.postings:
        name, currency = paper.names.accounts[line.account], paper.names.currencies[line.currency]
        yield f"  {name}  {line.amount} {currency}\n"
    yield "\n"


def foot(paper: Paper) -> Iterator[str]:
    """Give what waits, the balances at the end, and which accounts are closed."""
    yield from waiting(paper)
    day = paper.day_after
    if day is None:
        return
    for account in sorted(paper.accounts.values(), key=lambda one: paper.names.accounts[one.id]):
        name, currency = paper.names.accounts[account.id], paper.names.currencies[account.currency]
        # Without a tolerance of its own the smallest unit could be off.
        yield f"{day} balance {name}  {format_amount(account.posted, account.currency)} ~ 0 {currency}\n"
        if account.closed:
            yield f"{day} close {name}\n"


def _meta(key: str, value: str) -> str:
    return f"  {key}: {_text(value)}\n"


def _text(text: str) -> str:
    escaped = one_line(text).replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
