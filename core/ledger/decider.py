"""The decider: a command and the book in, events or a rejection out.

`decide` answers what the book has to say about a wish and changes nothing; what its events then do to the accounts is
`evolving`'s. A command that says what it has seen is held against that before anything else. A batch is decided by applying the changes of each command before the next one is asked, so two commands that
spend the same money can't both succeed; and because a command is judged wholly before its changes are taken,
a refused one leaves nothing behind.
"""

from typing import Final, assert_never

import msgspec

from core.ledger import two_phases
from core.ledger.book import Book, KnownEntry
from core.ledger.commands import (
    BATCH_TRANSACTIONS_MAX,
    AssertBalance,
    AtomicBatch,
    CloseAccount,
    Command,
    ExpirePending,
    OpenAccount,
    PostPending,
    PostTransaction,
    ReverseTransaction,
    VoidPending,
    expected_versions_of,
)
from core.ledger.entries import EntryDetails, Origin, RecordEntry, ReplaceEntry, ReverseEntry
from core.ledger.events import (
    AccountClosed,
    AccountOpened,
    BalanceAsserted,
    EntryPosted,
    Event,
    TransactionReversed,
    lines_of,
    opposite,
    posted,
    postings_of,
    reversal_of,
)
from core.ledger.evolving import Accounts, evolve
from core.ledger.household import Resolved, resolve
from core.ledger.limits import amount_of_entry, amount_of_line, beyond, nothing_in_particular, unusable
from core.ledger.money import fits, format_amount, parse_amount
from core.ledger.planning import decide_plan
from core.ledger.plans import EndRecurring, SetBudget, SetRecurring
from core.ledger.reasons import Reason, Rejection, Slug, reject, within

EVENTS_PER_COMMAND_MAX: Final = 4  # a replacement: the reversal, two accounts of first use, the entry
EVENTS_PER_BATCH_MAX: Final = BATCH_TRANSACTIONS_MAX


def decide(command: Command, book: Book) -> tuple[Event, ...] | Rejection:
    """Return what happens if this command is carried out, or why the book refuses it.

    `book` holds what exists of that which the command touches. Several events belong to one command only
    together, and the last of them is the one it was sent for: accounts are opened before they are used, and
    what stood is reversed before something else is booked.
    """
    return _changed_since(command, book) or _decide(command, book)


def _decide(command: Command, book: Book) -> tuple[Event, ...] | Rejection:
    match command:
        case OpenAccount():
            return _open(command, book.accounts)
        case CloseAccount():
            return _close(command, book.accounts)
        case PostTransaction():
            return _post(command, book.accounts, book.now_ns)
        case PostPending():
            return two_phases.post(command, book)
        case VoidPending():
            return two_phases.void(command, book)
        case ExpirePending():
            return two_phases.expire(command, book)
        case ReverseTransaction():
            return _reverse_transaction(command, book)
        case AssertBalance():
            return _assert(command, book)
        case AtomicBatch():
            return _post_all(command, book)
        case RecordEntry():
            return _record(command, book)
        case ReplaceEntry():
            return _replace(command, book)
        case ReverseEntry():
            return _reverse(command, book)
        case SetBudget() | SetRecurring() | EndRecurring():
            return decide_plan(command, book)
        case _:
            assert_never(command)


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
    if account.has_pending:
        return reject(Slug.ACCOUNT_HAS_PENDING, "", Reason.PENDING, account=command.id)
    return (AccountClosed(command.id),)


def _changed_since(command: Command, book: Book) -> Rejection | None:
    for name, version in sorted(expected_versions_of(command).items()):
        account = book.accounts.get(name)
        if account is None or account.version != version:
            now = account.version if account is not None else 0
            return reject(Slug.ACCOUNT_CHANGED, "", Reason.CHANGED, account=name, version=str(now))
    return None


def _post(command: PostTransaction, accounts: Accounts, now_ns: int) -> tuple[Event, ...] | Rejection:
    refused = unusable(command.postings, accounts)
    if refused is not None:
        return refused
    if command.pending:
        return two_phases.reserve(command, accounts, now_ns)
    events = (posted(command),)
    return beyond(events, accounts, command.postings, amount_of_line) or events


def _post_all(command: AtomicBatch, book: Book) -> tuple[Event, ...] | Rejection:
    """Decide one after the other, each on what those before it have left; the first no is that of all."""
    accounts = dict(book.accounts)
    events: list[Event] = []
    for place, one in enumerate(command.commands):
        decided = _post(one, accounts, book.now_ns)
        if isinstance(decided, Rejection):
            return within(decided, f"/transactions/{place}")
        for event in decided:
            accounts |= evolve(accounts, event)
            events.append(event)
    if not events:
        return reject(Slug.INVALID_BODY, "/transactions", Reason.TOO_FEW)
    return tuple(events)


def _reverse_transaction(command: ReverseTransaction, book: Book) -> tuple[Event, ...] | Rejection:
    known = book.bookings.get(command.id)
    if known is None:
        pending = book.pendings.get(command.id)
        if pending is not None:
            return two_phases.ended(pending.state)
        return reject(Slug.TRANSACTION_NOT_FOUND, "", Reason.UNKNOWN_TRANSACTION)
    if isinstance(known.event, TransactionReversed):
        return reject(Slug.ALREADY_A_REVERSAL, "", Reason.IS_REVERSAL, transaction=known.event.reverses)
    if isinstance(known.event, EntryPosted):
        return reject(Slug.TRANSACTION_OF_ENTRY, "", Reason.OF_ENTRY, entry=known.event.entry)
    if known.reversed:
        return reject(Slug.TRANSACTION_REVERSED, "", Reason.REVERSED)
    lines = opposite(known.event)
    for line in lines:
        if book.accounts[line.account].closed:
            return reject(Slug.ACCOUNT_CLOSED, "", Reason.CLOSED, account=line.account)
        if not fits(line.amount):
            account = book.accounts[line.account]
            values = {
                "account": account.id,
                "balance": format_amount(account.posted, account.currency),
                "currency": account.currency,
            }
            return reject(Slug.BALANCE_OUT_OF_RANGE, "", Reason.OUT_OF_RANGE, **values)
    reversal = reversal_of(known.event, command.reversal)
    return beyond((reversal,), book.accounts, lines, nothing_in_particular) or (reversal,)


def _assert(command: AssertBalance, book: Book) -> tuple[Event, ...] | Rejection:
    account = book.accounts.get(command.account)
    if account is None:
        return reject(Slug.UNKNOWN_ACCOUNT, "/account", Reason.UNKNOWN_ACCOUNT, account=command.account)
    if account.closed:
        return reject(Slug.ACCOUNT_CLOSED, "/account", Reason.CLOSED, account=account.id)
    amount = parse_amount(command.amount, account.currency)
    if isinstance(amount, Reason):
        return reject(Slug.INVALID_BODY, "/amount", amount)
    actual = book.dated.get((account.id, command.date), 0)
    spelled = format_amount(actual, account.currency)
    # By days a balance may pass through what it never was in the order in which it was booked.
    if not fits(actual):
        values = {"account": account.id, "balance": spelled, "currency": account.currency}
        return reject(Slug.BALANCE_OUT_OF_RANGE, "/date", Reason.OUT_OF_RANGE, **values)
    asserted = BalanceAsserted(
        command.id,
        account.id,
        command.date,
        format_amount(amount, account.currency),
        account.currency,
        spelled,
        holds=amount == actual,
    )
    return (asserted,)


def _record(command: RecordEntry, book: Book) -> tuple[Event, ...] | Rejection:
    origin = command.origin
    if origin is not None and origin.fingerprint in book.fingerprints and not command.duplicates_wanted:
        return reject(Slug.ALREADY_IMPORTED, "", Reason.EXISTS)
    meant = resolve(command.details, book)
    if isinstance(meant, Rejection):
        return meant
    entry = _entry_posted(command.details, meant, command.id, command.id, origin)
    events: tuple[Event, ...] = (*meant.opened, entry)
    return beyond(events, book.accounts, meant.postings, amount_of_entry) or events


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
    return beyond(events, book.accounts, lines, amount_of_entry) or events


def _reverse(command: ReverseEntry, book: Book) -> tuple[Event, ...] | Rejection:
    known = _standing(command, book)
    if isinstance(known, Rejection):
        return known
    reversal = reversal_of(known.event, command.reversal)
    return beyond((reversal,), book.accounts, postings_of(reversal), nothing_in_particular) or (reversal,)


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
