"""Events: what has happened to the book, in the words it is kept in for ever.

Each kind carries the version of its shape, and its amounts are decimal strings with the currency's digits: an
event can be read and added up in fifty years by somebody who has neither this program nor its table of
exponents. The bytes made here are what the chain hashes and what the store keeps; nothing ever encodes an
event a second time. Deltas or plain rows were not chosen: the event is the truth, every table is a reading.
A reversal names what it reverses and spells its own lines out: whoever adds up postings needs no other event. For
the same reason whatever ends a pending transaction spells out the lines that it releases.
An event in an older shape than today's is raised to it when it is read (`upcasting`), and never written anew.
"""

from typing import Final, assert_never

import msgspec

from core.ledger.accounts import AccountType
from core.ledger.commands import Posting, PostTransaction
from core.ledger.entries import Origin
from core.ledger.moments import moment_ns, timestamp
from core.ledger.money import format_amount, parse_amount
from core.ledger.plans import BudgetSet, PlanEvent, RecurringEnded, RecurringSet, is_readable
from core.ledger.reasons import Reason
from core.ledger.upcasting import UPCASTS, Upcasts, raised


class AccountOpened(msgspec.Struct, frozen=True, tag_field="kind", tag="account.opened"):
    """An account was opened, empty."""

    id: str
    name: str
    type: AccountType
    currency: str
    no_overdraft: bool
    v: int = 1


class AccountClosed(msgspec.Struct, frozen=True, tag_field="kind", tag="account.closed"):
    """An account takes no more postings."""

    id: str
    v: int = 1


class PostingLine(msgspec.Struct, frozen=True):
    """One line of a booked transaction; the amount is a decimal string, debit positive."""

    account: str
    amount: str
    currency: str


class TransactionPosted(msgspec.Struct, frozen=True, tag_field="kind", tag="transaction.posted"):
    """A transaction was booked."""

    id: str
    date: str
    description: str
    tags: tuple[str, ...]
    postings: tuple[PostingLine, ...]
    v: int = 1


class EntryPosted(msgspec.Struct, frozen=True, tag_field="kind", tag="entry.posted"):
    """An entry of the household was booked as the transaction `id`; its first posting moves the money.

    `entry` is what the entry is called for ever: the id of its first transaction. `category` None: the entry
    has none, and its second posting stands on the account for that.
    """

    id: str
    entry: str
    date: str
    description: str
    tags: tuple[str, ...]
    postings: tuple[PostingLine, ...]
    category: str | None
    payment_method: str | None
    origin: Origin | None
    v: int = 1


class TransactionReversed(msgspec.Struct, frozen=True, tag_field="kind", tag="transaction.reversed"):
    """The transaction `reverses` was taken back by the opposite transaction `id`, on the same day.

    `entry`: the household's entry that it belonged to, if it belonged to one.
    """

    id: str
    reverses: str
    entry: str | None
    date: str
    description: str
    postings: tuple[PostingLine, ...]
    v: int = 1


class TransactionPending(msgspec.Struct, frozen=True, tag_field="kind", tag="transaction.pending"):
    """A transaction was made pending: its lines are reserved until it is posted, voided or runs out.

    `expires_at`: from then on it can't be posted any more; None: it waits for as long as it takes.
    """

    id: str
    date: str
    description: str
    tags: tuple[str, ...]
    postings: tuple[PostingLine, ...]
    expires_at: str | None
    v: int = 1


class PendingPosted(msgspec.Struct, frozen=True, tag_field="kind", tag="pending.posted"):
    """A pending transaction was booked, whole or in part, as the transaction `id`; all that it held is `released`."""

    id: str
    pending: str
    date: str
    description: str
    tags: tuple[str, ...]
    postings: tuple[PostingLine, ...]
    released: tuple[PostingLine, ...]
    v: int = 1


class PendingVoided(msgspec.Struct, frozen=True, tag_field="kind", tag="pending.voided"):
    """A pending transaction was given up: what it held is `released`, and nothing was booked."""

    pending: str
    released: tuple[PostingLine, ...]
    v: int = 1


class PendingExpired(msgspec.Struct, frozen=True, tag_field="kind", tag="pending.expired"):
    """A pending transaction has run out: what it held is `released`, and nothing was booked."""

    pending: str
    released: tuple[PostingLine, ...]
    v: int = 1


class BalanceAsserted(msgspec.Struct, frozen=True, tag_field="kind", tag="balance.asserted"):
    """Somebody has said what an account stood at by the end of a day, and the book has said what it knows of that.

    `actual` is what was posted to the account for that day and the days before it; `holds`: the two are the same.
    """

    id: str
    account: str
    date: str
    amount: str
    currency: str
    actual: str
    holds: bool
    v: int = 1


Booking = TransactionPosted | EntryPosted | TransactionReversed | PendingPosted
Release = PendingPosted | PendingVoided | PendingExpired
OfAccount = AccountOpened | AccountClosed
Event = (
    OfAccount | Booking | TransactionPending | PendingVoided | PendingExpired | BalanceAsserted | PlanEvent
)

EVENT_VERSION: Final = 1  # of every kind, today
ENTRY_POSTINGS: Final = 2  # the money, and what it was for
_DECODER: Final = msgspec.json.Decoder(Event)


def posted(command: PostTransaction) -> TransactionPosted:
    """Return the event in which this command comes true, if it is not to be pending."""
    return TransactionPosted(
        command.id, command.date, command.description, command.tags, lines_of(command.postings)
    )


def made_pending(command: PostTransaction, expires_ns: int | None) -> TransactionPending:
    """Return the event in which this command comes true, if it is to be pending until `expires_ns` (wall time)."""
    return TransactionPending(
        command.id,
        command.date,
        command.description,
        command.tags,
        lines_of(command.postings),
        timestamp(expires_ns) if expires_ns is not None else None,
    )


def expiry_of(event: TransactionPending) -> int | None:
    """Return the wall time in nanoseconds at which a pending transaction runs out, None if it never does."""
    return moment_ns(event.expires_at) if event.expires_at is not None else None


def reversal_of(event: Booking, transaction_id: str) -> TransactionReversed:
    """Return the event that takes a transaction back."""
    entry = event.entry if isinstance(event, EntryPosted) else None
    return TransactionReversed(
        transaction_id, event.id, entry, event.date, event.description, lines_of(opposite(event))
    )


def opposite(event: Booking) -> tuple[Posting, ...]:
    """Return the lines that take a transaction back. Of the lowest amount there is no opposite that fits 64 bits."""
    return tuple(
        Posting(posting.account, -posting.amount, posting.currency) for posting in postings_of(event)
    )


def lines_of(postings: tuple[Posting, ...]) -> tuple[PostingLine, ...]:
    """Return postings in the words of an event."""
    return tuple(
        PostingLine(posting.account, format_amount(posting.amount, posting.currency), posting.currency)
        for posting in postings
    )


def postings_of(event: Booking | TransactionPending) -> tuple[Posting, ...]:
    """Return the lines of a transaction in minor units."""
    return _in_minor_units(event.postings)


def released_by(event: Release) -> tuple[Posting, ...]:
    """Return the lines of the pending transaction that this event ends, in minor units."""
    return _in_minor_units(event.released)


def asserted_amounts(event: BalanceAsserted) -> tuple[int, int]:
    """Return what was asserted and what was the case, in minor units."""
    amount = parse_amount(event.amount, event.currency)
    actual = parse_amount(event.actual, event.currency)
    assert isinstance(amount, int), "a stored assertion holds an amount that was never one"
    assert isinstance(actual, int), "a stored assertion holds a balance that was never one"
    return amount, actual


def accounts_in(event: Event) -> tuple[str, ...]:
    """Return the accounts that an event speaks of, each once."""
    match event:
        case AccountOpened() | AccountClosed():
            return (event.id,)
        case BalanceAsserted() | BudgetSet():
            return (event.account,)
        case RecurringSet() | RecurringEnded():
            return ()
        case PendingPosted():
            lines = (*event.postings, *event.released)
        case PendingVoided() | PendingExpired():
            lines = event.released
        case TransactionPosted() | EntryPosted() | TransactionReversed() | TransactionPending():
            lines = event.postings
        case _:
            assert_never(event)
    return tuple(dict.fromkeys(line.account for line in lines))


def id_in(event: Event) -> str:
    """Return the id by which an event is told: of its transaction, its account, or what was asserted."""
    if isinstance(event, PendingVoided | PendingExpired):
        return event.pending
    return event.account if isinstance(event, BudgetSet) else event.id


def kind_of(event: Event) -> str:
    """Return the kind of an event, as its row and its body name it."""
    return str(event.__struct_config__.tag)


def encode(event: Event) -> bytes:
    """Return the bytes of an event that are hashed and stored."""
    return msgspec.json.encode(event)


def decode(body: bytes, upcasts: Upcasts = UPCASTS) -> Event | None:
    """Return the event in stored bytes, or None if they hold no event that this version knows.

    A body of an older shape is raised to today's by `upcasts`; one of a shape that is still to come is not known.
    """
    event = _decoded(body)
    if event is None or event.v != EVENT_VERSION:
        lifted = raised(body, upcasts)
        event = _decoded(lifted) if lifted is not None else None
    known = event is not None and event.v == EVENT_VERSION and _is_readable(event)
    return event if known else None


def _decoded(body: bytes) -> Event | None:
    try:
        event: Event = _DECODER.decode(body)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    return event


def _is_readable(event: Event) -> bool:
    match event:
        case AccountOpened() | AccountClosed():
            return True
        case BudgetSet() | RecurringSet() | RecurringEnded():
            return is_readable(event)
        case BalanceAsserted():
            return _are_amounts((event.amount, event.actual), event.currency)
        case PendingPosted():
            return _has_readable(event.postings) and _has_readable(event.released)
        case PendingVoided() | PendingExpired():
            return _has_readable(event.released)
        case TransactionPending():
            ends = event.expires_at is None or expiry_of(event) is not None
            return ends and _has_readable(event.postings)
        case EntryPosted():
            return len(event.postings) == ENTRY_POSTINGS and _has_readable(event.postings)
        case TransactionPosted() | TransactionReversed():
            return _has_readable(event.postings)
        case _:
            assert_never(event)


def _has_readable(lines: tuple[PostingLine, ...]) -> bool:
    return all(isinstance(parse_amount(line.amount, line.currency), int) for line in lines)


def _are_amounts(texts: tuple[str, ...], currency: str) -> bool:
    return all(isinstance(parse_amount(text, currency), int) for text in texts)


def _in_minor_units(lines: tuple[PostingLine, ...]) -> tuple[Posting, ...]:
    return tuple(Posting(line.account, _minor(line), line.currency) for line in lines)


def _minor(line: PostingLine) -> int:
    amount = parse_amount(line.amount, line.currency)
    assert not isinstance(amount, Reason), "a stored event holds an amount that was never one"
    return amount
