"""The decider: a command and the book in, events or a rejection out; an event and the book in, the changes out.

`decide` answers what the book has to say about a wish and changes nothing. `evolve` says what an event does to
the accounts and refuses nothing: it is the same for a command of this second and for a replay of ten years.
A batch is decided by applying the changes of each command before the next one is asked, so two commands that
spend the same money can't both succeed; and because a command is judged wholly before its changes are taken,
a refused one leaves nothing behind.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import assert_never

from core.ledger.accounts import Account, is_overdrawn
from core.ledger.commands import CloseAccount, Command, OpenAccount, PostTransaction
from core.ledger.events import (
    AccountClosed,
    AccountOpened,
    Event,
    TransactionPosted,
    posted,
    postings_of,
)
from core.ledger.money import fits, format_amount
from core.ledger.reasons import Fault, Reason, Rejection, Slug, reject

Book = Mapping[str, Account]


def decide(command: Command, book: Book) -> tuple[Event, ...] | Rejection:
    """Return what happens if this command is carried out, or why the book refuses it.

    `book` holds the accounts that exist among those the command touches.
    """
    match command:
        case OpenAccount():
            return _open(command, book)
        case CloseAccount():
            return _close(command, book)
        case PostTransaction():
            return _post(command, book)
        case _:
            assert_never(command)


def evolve(book: Book, event: Event) -> dict[str, Account]:
    """Return the accounts that the event changes, as they are after it."""
    match event:
        case AccountOpened():
            account = Account(event.id, event.name, event.type, event.currency, event.no_overdraft)
            return {event.id: account}
        case AccountClosed():
            return {event.id: replace(book[event.id], closed=True)}
        case TransactionPosted():
            after: dict[str, Account] = {}
            for name, change in _changes(event).items():
                after[name] = replace(book[name], posted=book[name].posted + change)
            return after
        case _:
            assert_never(event)


def _open(command: OpenAccount, book: Book) -> tuple[Event, ...] | Rejection:
    if command.id in book:
        return reject(Slug.ACCOUNT_EXISTS, "/id", Reason.EXISTS, account=command.id)
    opened = AccountOpened(command.id, command.name, command.type, command.currency, command.no_overdraft)
    return (opened,)


def _close(command: CloseAccount, book: Book) -> tuple[Event, ...] | Rejection:
    account = book.get(command.id)
    if account is None:
        return reject(Slug.UNKNOWN_ACCOUNT, "", Reason.UNKNOWN_ACCOUNT, account=command.id)
    if account.closed:
        return reject(Slug.ACCOUNT_CLOSED, "", Reason.CLOSED, account=command.id)
    return (AccountClosed(command.id),)


def _post(command: PostTransaction, book: Book) -> tuple[Event, ...] | Rejection:
    refused = (
        _unknown_accounts(command, book)
        or _closed_accounts(command, book)
        or _other_currencies(command, book)
    )
    if refused is not None:
        return refused
    event = posted(command)
    return _limits(command, evolve(book, event)) or (event,)


def _unknown_accounts(command: PostTransaction, book: Book) -> Rejection | None:
    lines = [n for n, posting in enumerate(command.postings) if posting.account not in book]
    if not lines:
        return None
    account = command.postings[lines[0]].account
    faults = _faults(lines, "account", Reason.UNKNOWN_ACCOUNT)
    return Rejection(Slug.UNKNOWN_ACCOUNT, faults, {"account": account})


def _closed_accounts(command: PostTransaction, book: Book) -> Rejection | None:
    lines = [n for n, posting in enumerate(command.postings) if book[posting.account].closed]
    if not lines:
        return None
    account = command.postings[lines[0]].account
    return Rejection(Slug.ACCOUNT_CLOSED, _faults(lines, "account", Reason.CLOSED), {"account": account})


def _other_currencies(command: PostTransaction, book: Book) -> Rejection | None:
    lines = [n for n, line in enumerate(command.postings) if book[line.account].currency != line.currency]
    if not lines:
        return None
    first = command.postings[lines[0]]
    values = {"account": first.account, "given": first.currency, "currency": book[first.account].currency}
    return Rejection(Slug.CURRENCY_DIFFERS, _faults(lines, "currency", Reason.CURRENCY_DIFFERS), values)


def _limits(command: PostTransaction, after: Book) -> Rejection | None:
    """Judge the balances as they would be. A line is at fault if its account is."""
    for slug, reason, broken in (
        (
            Slug.BALANCE_OUT_OF_RANGE,
            Reason.OUT_OF_RANGE,
            {a.id for a in after.values() if not fits(a.posted)},
        ),
        (Slug.OVERDRAFT, Reason.OVERDRAFT, {a.id for a in after.values() if _forbidden(a)}),
    ):
        lines = [n for n, posting in enumerate(command.postings) if posting.account in broken]
        if lines:
            account = after[command.postings[lines[0]].account]
            balance = format_amount(account.posted, account.currency)
            values = {"account": account.id, "balance": balance, "currency": account.currency}
            return Rejection(slug, _faults(lines, "amount", reason), values)
    return None


def _faults(lines: list[int], member: str, reason: Reason) -> tuple[Fault, ...]:
    return tuple(Fault(f"/postings/{line}/{member}", reason) for line in lines)


def _forbidden(account: Account) -> bool:
    return account.no_overdraft and is_overdrawn(account.type, account.posted)


def _changes(event: TransactionPosted) -> dict[str, int]:
    changes: dict[str, int] = {}
    for posting in postings_of(event):
        changes[posting.account] = changes.get(posting.account, 0) + posting.amount
    return changes
