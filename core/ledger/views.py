"""How the book is told: the shapes that answers have, made from accounts and events.

One shape per thing, whether it was booked this millisecond or read back next year: the answer that is stored
under a command's key and the answer of a later GET are made by the same function and can't drift apart.
Times are RFC 3339 in UTC with all nine digits, so that anybody can hash an event again from what is shown.
"""

from collections.abc import Iterable
from types import MappingProxyType
from typing import Final, assert_never

import msgspec

from core.ledger.accounts import Account
from core.ledger.book import PendingState
from core.ledger.events import (
    AccountClosed,
    AccountOpened,
    BalanceAsserted,
    Booking,
    EntryPosted,
    Event,
    PendingExpired,
    PendingPosted,
    PendingVoided,
    PostingLine,
    TransactionPending,
    TransactionPosted,
    TransactionReversed,
    accounts_in,
    asserted_amounts,
    id_in,
    kind_of,
)
from core.ledger.moments import timestamp
from core.ledger.money import format_amount
from core.ledger.plans import BudgetSet, RecurringEnded, RecurringSet


class Place(msgspec.Struct, frozen=True):
    """Where an event stands in the chain. `booked_ns` is wall time since 1970; `hash` is 32 raw bytes."""

    seq: int
    epoch: int
    booked_ns: int
    hash: bytes


class Balances(msgspec.Struct, frozen=True):
    """Balances as decimal strings, debit positive.

    `pending` is what open pending transactions would move altogether, `available` what is posted less what they may
    still take out; what they may bring in is not there yet.
    """

    posted: str
    pending: str
    available: str


class AccountView(msgspec.Struct, frozen=True):
    """An account as answers show it."""

    id: str
    name: str
    type: str
    currency: str
    no_overdraft: bool
    closed: bool
    balances: Balances
    version: int


class AccountAnswer(msgspec.Struct, frozen=True):
    """The answer to a command on an account: the account and the event that made it so."""

    id: str
    name: str
    type: str
    currency: str
    no_overdraft: bool
    closed: bool
    balances: Balances
    version: int
    seq: int
    epoch: int
    hash: str
    booked_at: str


class TransactionView(msgspec.Struct, frozen=True):
    """A transaction as answers show it.

    `entry`: the household's entry it belongs to; `reverses`: the transaction it takes back; `reversed_by`: the one that
    takes it back. `state`: `posted`, `set-aside` of one whose event is left out (what its event alone says, tags, is not
    shown then), or that of a pending one: `pending`, `voided`, `expired`, or `pending-posted`, which was booked as another.
    `pending`: the pending transaction that it books; `posted_by`: the one that books it. `expires_at`: of a pending one.
    """

    id: str
    seq: int
    epoch: int
    hash: str
    booked_at: str
    date: str
    description: str
    state: str
    tags: tuple[str, ...]
    postings: tuple[PostingLine, ...]
    entry: str | None
    reverses: str | None
    reversed_by: str | None = None
    pending: str | None = None
    posted_by: str | None = None
    expires_at: str | None = None


class PendingEnd(msgspec.Struct, frozen=True):
    """The answer to a command that ended a pending transaction without booking anything."""

    id: str
    seq: int
    epoch: int
    hash: str
    booked_at: str
    state: str
    released: tuple[PostingLine, ...]


class BatchItem(msgspec.Struct, frozen=True):
    """One transaction of a batch that was booked as a whole."""

    id: str
    seq: int
    hash: str
    state: str


class BatchAnswer(msgspec.Struct, frozen=True):
    """The answer to a batch that was booked as a whole: the place of its last event, and each of its transactions."""

    seq: int
    epoch: int
    hash: str
    booked_at: str
    items: tuple[BatchItem, ...]


class AssertionView(msgspec.Struct, frozen=True):
    """What somebody said an account should stand at by the end of a day, and what the book knew of that then.

    `off_by`: what is missing on the account if positive, too much on it if negative; zero where it `holds`.
    """

    id: str
    seq: int
    epoch: int
    hash: str
    booked_at: str
    account: str
    date: str
    amount: str
    currency: str
    actual: str
    off_by: str
    holds: bool


class EntryView(msgspec.Struct, frozen=True):
    """An entry as answers show it: its newest content, and the event that made it so.

    `amount` is minus for what was spent; `category` and `payment_method` are names or null; `transaction` is
    the one beneath it that stands.
    """

    id: str
    seq: int
    epoch: int
    hash: str
    booked_at: str
    date: str
    amount: str
    currency: str
    account: str
    account_name: str
    category: str | None
    category_account: str
    description: str
    payment_method: str | None
    tags: tuple[str, ...]
    transaction: str


class EntryReversal(msgspec.Struct, frozen=True):
    """The answer to the reversal of an entry: the transaction that took back the one that stood."""

    id: str
    seq: int
    epoch: int
    hash: str
    booked_at: str
    transaction: str
    reverses: str


class CommittedEvent(msgspec.Struct, frozen=True):
    """What is told of an event to whoever listens: enough to know whether to read anew, and not its content.

    `id` is that of the transaction or the account; `date` is None where nothing was booked; `accounts` are the
    ones it touched.
    """

    seq: int
    kind: str
    id: str
    date: str | None
    description: str
    accounts: tuple[str, ...]


class EventView(msgspec.Struct, frozen=True):
    """An event as answers show it; `body` holds the very bytes that were hashed."""

    seq: int
    epoch: int
    booked_at: str
    kind: str
    command_id: str
    key: str | None
    hash: str
    body: msgspec.Raw


def view_account(account: Account) -> AccountView:
    """Return the account as answers show it."""
    return AccountView(
        id=account.id,
        name=account.name,
        type=account.type.value,
        currency=account.currency,
        no_overdraft=account.no_overdraft,
        closed=account.closed,
        balances=balances_of(account),
        version=account.version,
    )


def answer_account(account: Account, place: Place) -> AccountAnswer:
    """Return the answer to a command that made the account what it is."""
    view = view_account(account)
    return AccountAnswer(
        **msgspec.structs.asdict(view),
        seq=place.seq,
        epoch=place.epoch,
        hash=place.hash.hex(),
        booked_at=timestamp(place.booked_ns),
    )


def view_transaction(
    event: Booking, place: Place, *, set_aside: bool = False, reversed_by: str | None = None
) -> TransactionView:
    """Return a booked transaction as answers show it. `set_aside`: its event is left out, and was not read."""
    return TransactionView(
        id=event.id,
        seq=place.seq,
        epoch=place.epoch,
        hash=place.hash.hex(),
        booked_at=timestamp(place.booked_ns),
        date=event.date,
        description=event.description,
        state="set-aside" if set_aside else "posted",
        tags=() if isinstance(event, TransactionReversed) else event.tags,
        postings=event.postings,
        entry=event.entry if isinstance(event, EntryPosted | TransactionReversed) else None,
        reverses=event.reverses if isinstance(event, TransactionReversed) else None,
        reversed_by=reversed_by,
        pending=event.pending if isinstance(event, PendingPosted) else None,
    )


def view_pending(
    event: TransactionPending,
    place: Place,
    state: PendingState = PendingState.OPEN,
    *,
    posted_by: str | None = None,
    set_aside: bool = False,
) -> TransactionView:
    """Return a pending transaction as answers show it, with what became of it."""
    return TransactionView(
        id=event.id,
        seq=place.seq,
        epoch=place.epoch,
        hash=place.hash.hex(),
        booked_at=timestamp(place.booked_ns),
        date=event.date,
        description=event.description,
        state="set-aside" if set_aside else _PENDING_STATES[state],
        tags=event.tags,
        postings=event.postings,
        entry=None,
        reverses=None,
        posted_by=posted_by,
        expires_at=event.expires_at,
    )


def answer_end(event: PendingVoided | PendingExpired, place: Place) -> PendingEnd:
    """Return the answer to a command that ended a pending transaction without booking anything."""
    state = PendingState.VOIDED if isinstance(event, PendingVoided) else PendingState.EXPIRED
    return PendingEnd(
        id=event.pending,
        seq=place.seq,
        epoch=place.epoch,
        hash=place.hash.hex(),
        booked_at=timestamp(place.booked_ns),
        state=_PENDING_STATES[state],
        released=event.released,
    )


def answer_batch(events: Iterable[tuple[Event, Place]]) -> BatchAnswer:
    """Return the answer to transactions that were booked all together."""
    items = []
    for event, place in events:
        state = "pending" if isinstance(event, TransactionPending) else "posted"
        items.append(BatchItem(id_in(event), place.seq, place.hash.hex(), state))
    return BatchAnswer(place.seq, place.epoch, place.hash.hex(), timestamp(place.booked_ns), tuple(items))


def view_assertion(event: BalanceAsserted, place: Place) -> AssertionView:
    """Return an assertion as answers show it."""
    amount, actual = asserted_amounts(event)
    return AssertionView(
        id=event.id,
        seq=place.seq,
        epoch=place.epoch,
        hash=place.hash.hex(),
        booked_at=timestamp(place.booked_ns),
        account=event.account,
        date=event.date,
        amount=event.amount,
        currency=event.currency,
        actual=event.actual,
        off_by=format_amount(amount - actual, event.currency),
        holds=event.holds,
    )


def view_entry(event: EntryPosted, place: Place, account_name: str) -> EntryView:
    """Return an entry as answers show it; `account_name` is that of the account its money moved on."""
    money, category = event.postings
    return EntryView(
        id=event.entry,
        seq=place.seq,
        epoch=place.epoch,
        hash=place.hash.hex(),
        booked_at=timestamp(place.booked_ns),
        date=event.date,
        amount=money.amount,
        currency=money.currency,
        account=money.account,
        account_name=account_name,
        category=event.category,
        category_account=category.account,
        description=event.description,
        payment_method=event.payment_method,
        tags=event.tags,
        transaction=event.id,
    )


def answer_reversal(event: TransactionReversed, place: Place) -> EntryReversal:
    """Return the answer to a command that took back what stood of an entry."""
    assert event.entry is not None, "only entries are reversed"
    return EntryReversal(
        id=event.entry,
        seq=place.seq,
        epoch=place.epoch,
        hash=place.hash.hex(),
        booked_at=timestamp(place.booked_ns),
        transaction=event.id,
        reverses=event.reverses,
    )


def tell(event: Event, seq: int) -> CommittedEvent:
    """Return what is told of a committed event to whoever listens."""
    accounts = accounts_in(event)
    match event:
        case AccountOpened() | AccountClosed() | BalanceAsserted():
            # Who is told of an assertion reads its account anew, which is what it is about.
            return CommittedEvent(seq, kind_of(event), accounts[0], None, "", accounts)
        case BudgetSet() | RecurringEnded():
            return CommittedEvent(seq, kind_of(event), id_in(event), None, "", accounts)
        case RecurringSet():
            return CommittedEvent(seq, kind_of(event), event.id, None, event.plan.title, accounts)
        case PendingVoided() | PendingExpired():
            return CommittedEvent(seq, kind_of(event), event.pending, "", "", accounts)
        case TransactionPending():
            return CommittedEvent(seq, kind_of(event), event.id, event.date, event.description, accounts)
        case TransactionPosted() | EntryPosted() | TransactionReversed() | PendingPosted():
            return CommittedEvent(seq, kind_of(event), event.id, event.date, event.description, accounts)
        case _:
            assert_never(event)


def balances_of(account: Account) -> Balances:
    """Return the three balances of an account."""
    return Balances(
        posted=format_amount(account.posted, account.currency),
        pending=format_amount(account.pending, account.currency),
        available=format_amount(account.available, account.currency),
    )


_PENDING_STATES: Final = MappingProxyType(
    {
        PendingState.OPEN: "pending",
        PendingState.POSTED: "pending-posted",
        PendingState.VOIDED: "voided",
        PendingState.EXPIRED: "expired",
    }
)
