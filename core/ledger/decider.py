"""The decider: a command and the book in, events or a rejection out; an event and the book in, the changes out.

`decide` answers what the book has to say about a wish and changes nothing. `evolve` says what an event does to
the accounts and refuses nothing: it is the same for a command of this second and for a replay of ten years.
A batch is decided by applying the changes of each command before the next one is asked, so two commands that
spend the same money can't both succeed; and because a command is judged wholly before its changes are taken,
a refused one leaves nothing behind.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Final, assert_never

import msgspec

from core.ledger.accounts import Account, is_overdrawn
from core.ledger.book import Book, KnownEntry
from core.ledger.commands import CloseAccount, Command, OpenAccount, Posting, PostTransaction
from core.ledger.entries import EntryDetails, Origin, RecordEntry, ReplaceEntry, ReverseEntry
from core.ledger.events import (
    AccountClosed,
    AccountOpened,
    Booking,
    EntryPosted,
    Event,
    TransactionPosted,
    TransactionReversed,
    lines_of,
    posted,
    postings_of,
    reversal_of,
)
from core.ledger.household import Resolved, resolve
from core.ledger.money import fits, format_amount
from core.ledger.reasons import Fault, Reason, Rejection, Slug, reject

EVENTS_PER_COMMAND_MAX: Final = 4  # a replacement: the reversal, two accounts of first use, the entry

Accounts = Mapping[str, Account]


def decide(command: Command, book: Book) -> tuple[Event, ...] | Rejection:
    """Return what happens if this command is carried out, or why the book refuses it.

    `book` holds what exists of that which the command touches. Several events belong to one command only
    together, and the last of them is the one it was sent for: accounts are opened before they are used, and
    what stood is reversed before something else is booked.
    """
    match command:
        case OpenAccount():
            return _open(command, book.accounts)
        case CloseAccount():
            return _close(command, book.accounts)
        case PostTransaction():
            return _post(command, book.accounts)
        case RecordEntry():
            return _record(command, book)
        case ReplaceEntry():
            return _replace(command, book)
        case ReverseEntry():
            return _reverse(command, book)
        case _:
            assert_never(command)


def evolve(accounts: Accounts, event: Event) -> dict[str, Account]:
    """Return the accounts that the event changes, as they are after it."""
    match event:
        case AccountOpened():
            account = Account(event.id, event.name, event.type, event.currency, event.no_overdraft)
            return {event.id: account}
        case AccountClosed():
            return {event.id: msgspec.structs.replace(accounts[event.id], closed=True)}
        case TransactionPosted() | EntryPosted() | TransactionReversed():
            after: dict[str, Account] = {}
            for name, change in _changes(event).items():
                after[name] = msgspec.structs.replace(accounts[name], posted=accounts[name].posted + change)
            return after
        case _:
            assert_never(event)


def _open(command: OpenAccount, accounts: Accounts) -> tuple[Event, ...] | Rejection:
    if command.id in accounts:
        return reject(Slug.ACCOUNT_EXISTS, "/id", Reason.EXISTS, account=command.id)
    opened = AccountOpened(command.id, command.name, command.type, command.currency, command.no_overdraft)
    return (opened,)


def _close(command: CloseAccount, accounts: Accounts) -> tuple[Event, ...] | Rejection:
    account = accounts.get(command.id)
    if account is None:
        return reject(Slug.UNKNOWN_ACCOUNT, "", Reason.UNKNOWN_ACCOUNT, account=command.id)
    if account.closed:
        return reject(Slug.ACCOUNT_CLOSED, "", Reason.CLOSED, account=command.id)
    return (AccountClosed(command.id),)


def _post(command: PostTransaction, accounts: Accounts) -> tuple[Event, ...] | Rejection:
    refused = (
        _unknown_accounts(command, accounts)
        or _closed_accounts(command, accounts)
        or _other_currencies(command, accounts)
    )
    if refused is not None:
        return refused
    events = (posted(command),)
    return _limits(events, accounts, command.postings, _amount_of_line) or events


def _record(command: RecordEntry, book: Book) -> tuple[Event, ...] | Rejection:
    origin = command.origin
    if origin is not None and origin.fingerprint in book.fingerprints and not command.duplicates_wanted:
        return reject(Slug.ALREADY_IMPORTED, "", Reason.EXISTS)
    meant = resolve(command.details, book)
    if isinstance(meant, Rejection):
        return meant
    entry = _entry_posted(command.details, meant, command.id, command.id, origin)
    events: tuple[Event, ...] = (*meant.opened, entry)
    return _limits(events, book.accounts, meant.postings, _amount_of_entry) or events


def _replace(command: ReplaceEntry, book: Book) -> tuple[Event, ...] | Rejection:
    known = _standing(command, book)
    if isinstance(known, Rejection):
        return known
    details = command.details
    if command.keeps_the_rest:
        details = msgspec.structs.replace(
            details, payment_method=known.event.payment_method, tags=known.event.tags
        )
    meant = resolve(details, book)
    if isinstance(meant, Rejection):
        return meant
    reversal = reversal_of(known.event, command.reversal)
    entry = _entry_posted(details, meant, command.transaction, command.entry)
    events: tuple[Event, ...] = (reversal, *meant.opened, entry)
    lines = (*meant.postings, *postings_of(reversal))
    return _limits(events, book.accounts, lines, _amount_of_entry) or events


def _reverse(command: ReverseEntry, book: Book) -> tuple[Event, ...] | Rejection:
    known = _standing(command, book)
    if isinstance(known, Rejection):
        return known
    reversal = reversal_of(known.event, command.reversal)
    return _limits((reversal,), book.accounts, postings_of(reversal), _nothing_in_particular) or (reversal,)


def _standing(command: ReplaceEntry | ReverseEntry, book: Book) -> KnownEntry | Rejection:
    known = book.entries.get(command.entry)
    if known is None:
        return reject(Slug.ENTRY_NOT_FOUND, "", Reason.UNKNOWN_ENTRY)
    if known.reversed:
        return reject(Slug.ENTRY_REVERSED, "", Reason.REVERSED)
    if command.expected_seq not in {None, known.seq}:
        return reject(Slug.ENTRY_CHANGED, "/expected_seq", Reason.CHANGED)
    for posting in postings_of(known.event):
        if book.accounts[posting.account].closed:
            return reject(Slug.ACCOUNT_CLOSED, "", Reason.CLOSED, account=posting.account)
    return known


def _entry_posted(
    details: EntryDetails, meant: Resolved, transaction: str, entry: str, origin: Origin | None = None
) -> EntryPosted:
    return EntryPosted(
        transaction,
        entry,
        details.date,
        details.description,
        details.tags,
        lines_of(meant.postings),
        meant.category,
        meant.payment_method,
        origin,
    )


def _unknown_accounts(command: PostTransaction, accounts: Accounts) -> Rejection | None:
    lines = [n for n, posting in enumerate(command.postings) if posting.account not in accounts]
    if not lines:
        return None
    account = command.postings[lines[0]].account
    faults = _faults(lines, "account", Reason.UNKNOWN_ACCOUNT)
    return Rejection(Slug.UNKNOWN_ACCOUNT, faults, {"account": account})


def _closed_accounts(command: PostTransaction, accounts: Accounts) -> Rejection | None:
    lines = [n for n, posting in enumerate(command.postings) if accounts[posting.account].closed]
    if not lines:
        return None
    account = command.postings[lines[0]].account
    return Rejection(Slug.ACCOUNT_CLOSED, _faults(lines, "account", Reason.CLOSED), {"account": account})


def _other_currencies(command: PostTransaction, accounts: Accounts) -> Rejection | None:
    lines = [n for n, line in enumerate(command.postings) if accounts[line.account].currency != line.currency]
    if not lines:
        return None
    first = command.postings[lines[0]]
    values = {"account": first.account, "given": first.currency, "currency": accounts[first.account].currency}
    return Rejection(Slug.CURRENCY_DIFFERS, _faults(lines, "currency", Reason.CURRENCY_DIFFERS), values)


def _limits(
    events: Sequence[Event], accounts: Accounts, lines: Sequence[Posting], pointer: Callable[[int], str]
) -> Rejection | None:
    """Judge the balances as they would be after all the events, which touch what `lines` name.

    A line is at fault if its account is; `pointer` says where in the body it stands.
    """
    after = {line.account: accounts[line.account] for line in lines if line.account in accounts}
    for event in events:
        after |= evolve(after, event)
    for slug, reason, broken in (
        (
            Slug.BALANCE_OUT_OF_RANGE,
            Reason.OUT_OF_RANGE,
            {a.id for a in after.values() if not fits(a.posted)},
        ),
        (Slug.OVERDRAFT, Reason.OVERDRAFT, {a.id for a in after.values() if _forbidden(a)}),
    ):
        at_fault = [n for n, posting in enumerate(lines) if posting.account in broken]
        if at_fault:
            account = after[lines[at_fault[0]].account]
            balance = format_amount(account.posted, account.currency)
            values = {"account": account.id, "balance": balance, "currency": account.currency}
            faults = tuple(dict.fromkeys(Fault(pointer(n), reason) for n in at_fault))
            return Rejection(slug, faults, values)
    return None


def _amount_of_line(line: int) -> str:
    return f"/postings/{line}/amount"


def _amount_of_entry(_: int) -> str:
    return "/amount"


def _nothing_in_particular(_: int) -> str:
    return ""


def _faults(lines: list[int], member: str, reason: Reason) -> tuple[Fault, ...]:
    return tuple(Fault(f"/postings/{line}/{member}", reason) for line in lines)


def _forbidden(account: Account) -> bool:
    return account.no_overdraft and is_overdrawn(account.type, account.posted)


def _changes(event: Booking) -> dict[str, int]:
    changes: dict[str, int] = {}
    for posting in postings_of(event):
        changes[posting.account] = changes.get(posting.account, 0) + posting.amount
    return changes
