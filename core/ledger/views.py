"""How the book is told: the shapes that answers have, made from accounts and events.

One shape per thing, whether it was booked this millisecond or read back next year: the answer that is stored
under a command's key and the answer of a later GET are made by the same function and can't drift apart.
Times are RFC 3339 in UTC with all nine digits, so that anybody can hash an event again from what is shown.
"""

import datetime as dt

import msgspec

from core.ledger.accounts import Account
from core.ledger.events import (
    Booking,
    EntryPosted,
    Event,
    PostingLine,
    TransactionPosted,
    TransactionReversed,
    kind_of,
)
from core.ledger.money import format_amount


class Place(msgspec.Struct, frozen=True):
    """Where an event stands in the chain. `booked_ns` is wall time since 1970; `hash` is 32 raw bytes."""

    seq: int
    epoch: int
    booked_ns: int
    hash: bytes


class Balances(msgspec.Struct, frozen=True):
    """Balances as decimal strings, debit positive. Nothing can be pending yet, so `pending` is zero."""

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


class AccountAnswer(msgspec.Struct, frozen=True):
    """The answer to a command on an account: the account and the event that made it so."""

    id: str
    name: str
    type: str
    currency: str
    no_overdraft: bool
    closed: bool
    balances: Balances
    seq: int
    epoch: int
    hash: str
    booked_at: str


class TransactionView(msgspec.Struct, frozen=True):
    """A booked transaction as answers show it.

    `entry`: the household's entry it belongs to; `reverses`: the transaction it takes back. `state`: `posted`, or
    `set-aside` of one whose event is left out: what its event alone says (tags) is not shown.
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


def view_transaction(event: Booking, place: Place, *, set_aside: bool = False) -> TransactionView:
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
        entry=None if isinstance(event, TransactionPosted) else event.entry,
        reverses=event.reverses if isinstance(event, TransactionReversed) else None,
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
    if not isinstance(event, Booking):
        return CommittedEvent(seq, kind_of(event), event.id, None, "", (event.id,))
    accounts = tuple(dict.fromkeys(line.account for line in event.postings))
    return CommittedEvent(seq, kind_of(event), event.id, event.date, event.description, accounts)


def balances_of(account: Account) -> Balances:
    """Return the three balances of an account."""
    posted = format_amount(account.posted, account.currency)
    return Balances(posted=posted, pending=format_amount(0, account.currency), available=posted)


def timestamp(wall_ns: int) -> str:
    """Return wall time in nanoseconds since 1970 as RFC 3339 in UTC, to the nanosecond."""
    seconds, rest_ns = divmod(wall_ns, 1_000_000_000)
    day = dt.datetime.fromtimestamp(seconds, dt.UTC)
    return f"{day:%Y-%m-%dT%H:%M:%S}.{rest_ns:09d}Z"
