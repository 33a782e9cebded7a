"""A book in memory for tests: what is decided happens, through the bytes that would be stored."""

import itertools
from typing import Any

import msgspec

from core.ledger.accounts import Account, AccountType
from core.ledger.book import Book, KnownBooking, KnownPending, PendingState
from core.ledger.commands import (
    Command,
    Posting,
    PostPending,
    PostTransaction,
)
from core.ledger.decider import decide
from core.ledger.events import (
    Booking,
    Event,
    PendingExpired,
    PendingPosted,
    PendingVoided,
    Release,
    TransactionPending,
    TransactionReversed,
    decode,
    encode,
)
from core.ledger.evolving import evolve
from core.ledger.reasons import Rejection

SECOND = 1_000_000_000
NOW = 1_795_000_000 * SECOND
DAY = "2026-11-21"
_ids = itertools.count(1)
_STATES = {
    PendingPosted: PendingState.POSTED,
    PendingVoided: PendingState.VOIDED,
    PendingExpired: PendingState.EXPIRED,
}


class World:
    """A book that takes what is decided, as the writer's batch does, through the bytes that would be stored."""

    def __init__(self, *accounts: Account) -> None:
        self.book = Book.of(accounts or (account("cash", no_overdraft=True, posted=100), account("shop")))
        self.book.now_ns = NOW

    def does(self, command: Command) -> tuple[Event, ...]:
        events = decide(command, self.book)
        assert not isinstance(events, Rejection), events
        for event in events:
            read_back = decode(encode(event))
            assert read_back == event
            self.take(event)
        return events

    def take(self, event: Event) -> None:
        seq = next(_ids)
        self.book.update(evolve(self.book.accounts, event))
        if isinstance(event, Booking):
            self.book.bookings[event.id] = KnownBooking(seq, event)
        if isinstance(event, TransactionReversed):
            known = self.book.bookings[event.reverses]
            self.book.bookings[event.reverses] = msgspec.structs.replace(known, reversed=True)
        if isinstance(event, TransactionPending):
            self.book.pendings[event.id] = KnownPending(seq, event)
        if isinstance(event, Release):
            known_pending = self.book.pendings[event.pending]
            self.book.pendings[event.pending] = msgspec.structs.replace(
                known_pending, state=_STATES[type(event)]
            )

    def refuses(self, command: Command) -> Rejection:
        before = dict(self.book.accounts)
        found = decide(command, self.book)
        assert isinstance(found, Rejection), found
        assert self.book.accounts == before
        return found

    def reserve(self, amount: int, timeout_s: int | None = None) -> str:
        command = moved(amount, pending=True, timeout_s=timeout_s)
        self.does(command)
        return command.id

    def stands(self, name: str) -> tuple[int, int, int]:
        found = self.book.accounts[name]
        return found.posted, found.pending_debit, found.pending_credit


def account(name: str, *, no_overdraft: bool = False, posted: int = 0, **named: Any) -> Account:
    made = Account(name, name, AccountType.ASSET, "KRW", no_overdraft, posted, version=1)
    return msgspec.structs.replace(made, **named)


def moved(
    amount: int,
    to: str = "shop",
    source: str = "cash",
    *,
    pending: bool = False,
    timeout_s: int | None = None,
) -> PostTransaction:
    lines = (Posting(to, amount, "KRW"), Posting(source, -amount, "KRW"))
    return PostTransaction(f"t{next(_ids)}", DAY, "memo", ("tag",), lines, pending, timeout_s)


def part(pending: str, amount: int, *names: str) -> PostPending:
    to, source = names or ("shop", "cash")
    lines = (Posting(to, amount, "KRW"), Posting(source, -amount, "KRW"))
    return PostPending(f"p{next(_ids)}", pending, lines)


def whole(pending: str) -> PostPending:
    return PostPending(f"p{next(_ids)}", pending)
