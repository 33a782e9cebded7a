"""Evolving: an event and the accounts in, the accounts that it changes out.

It refuses nothing, because what has happened has happened: it is the same for a command of this second and for a replay
of ten years. Every event says itself whatever it takes to follow it (what ends a pending transaction spells out what that
one held), so a replay needs the accounts and nothing else.
"""

from collections.abc import Mapping, Sequence
from typing import assert_never

import msgspec

from core.ledger.accounts import Account
from core.ledger.commands import Posting
from core.ledger.events import (
    AccountClosed,
    AccountOpened,
    BalanceAsserted,
    EntryPosted,
    Event,
    PendingExpired,
    PendingPosted,
    PendingVoided,
    TransactionPending,
    TransactionPosted,
    TransactionReversed,
    postings_of,
    released_by,
)
from core.ledger.plans import BudgetSet, RecurringEnded, RecurringSet

Accounts = Mapping[str, Account]


def evolve(accounts: Accounts, event: Event) -> dict[str, Account]:
    """Return the accounts that the event changes, as they are after it."""
    match event:
        case AccountOpened():
            account = Account(event.id, event.name, event.type, event.currency, event.no_overdraft, version=1)
            return {event.id: account}
        case AccountClosed():
            account = accounts[event.id]
            return {event.id: msgspec.structs.replace(account, closed=True, version=account.version + 1)}
        case TransactionPosted() | EntryPosted() | TransactionReversed():
            return _changed(accounts, postings_of(event), (), ())
        case TransactionPending():
            return _changed(accounts, (), postings_of(event), ())
        case PendingPosted():
            return _changed(accounts, postings_of(event), (), released_by(event))
        case PendingVoided() | PendingExpired():
            return _changed(accounts, (), (), released_by(event))
        case BalanceAsserted() | BudgetSet() | RecurringSet() | RecurringEnded():
            return {}
        case _:
            assert_never(event)


def sides(amount: int) -> tuple[int, int]:
    """Return an amount as what it is on the debit and what it is on the credit side, neither negative."""
    return (amount, 0) if amount > 0 else (0, -amount)


def _changed(
    accounts: Accounts, posted: Sequence[Posting], reserved: Sequence[Posting], released: Sequence[Posting]
) -> dict[str, Account]:
    changes: dict[str, list[int]] = {}
    for line in posted:
        changes.setdefault(line.account, [0, 0, 0])[0] += line.amount
    for lines, sign in ((reserved, 1), (released, -1)):
        for line in lines:
            debit, credit = sides(line.amount)
            change = changes.setdefault(line.account, [0, 0, 0])
            change[1] += sign * debit
            change[2] += sign * credit
    after = {}
    for name, (moved, debit, credit) in changes.items():
        account = accounts[name]
        after[name] = msgspec.structs.replace(
            account,
            posted=account.posted + moved,
            pending_debit=account.pending_debit + debit,
            pending_credit=account.pending_credit + credit,
            version=account.version + 1,
        )
    return after
