"""How the book is told: the shapes that answers have, made from accounts and events.

One shape per thing, whether it was booked this millisecond or read back next year: the answer that is stored
under a command's key and the answer of a later GET are made by the same function and can't drift apart.
Times are RFC 3339 in UTC with all nine digits, so that anybody can hash an event again from what is shown.
"""

import datetime as dt
from dataclasses import dataclass

import msgspec

from core.ledger.accounts import Account
from core.ledger.events import PostingLine, TransactionPosted
from core.ledger.money import format_amount


@dataclass(frozen=True, slots=True)
class Place:
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
    """A booked transaction as answers show it."""

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


def view_transaction(event: TransactionPosted, place: Place) -> TransactionView:
    """Return a booked transaction as answers show it."""
    return TransactionView(
        id=event.id,
        seq=place.seq,
        epoch=place.epoch,
        hash=place.hash.hex(),
        booked_at=timestamp(place.booked_ns),
        date=event.date,
        description=event.description,
        state="posted",
        tags=event.tags,
        postings=event.postings,
    )


def balances_of(account: Account) -> Balances:
    """Return the three balances of an account."""
    posted = format_amount(account.posted, account.currency)
    return Balances(posted=posted, pending=format_amount(0, account.currency), available=posted)


def timestamp(wall_ns: int) -> str:
    """Return wall time in nanoseconds since 1970 as RFC 3339 in UTC, to the nanosecond."""
    seconds, rest_ns = divmod(wall_ns, 1_000_000_000)
    day = dt.datetime.fromtimestamp(seconds, dt.UTC)
    return f"{day:%Y-%m-%dT%H:%M:%S}.{rest_ns:09d}Z"
