"""Events: what has happened to the book, in the words it is kept in for ever.

Each kind carries the version of its shape, and its amounts are decimal strings with the currency's digits: an
event can be read and added up in fifty years by somebody who has neither this program nor its table of
exponents. The bytes made here are what the chain hashes and what the store keeps; nothing ever encodes an
event a second time. Deltas or plain rows were not chosen: the event is the truth, every table is a reading.
A reversal names what it reverses and spells its own lines out: whoever adds up postings needs no other event.
"""

from typing import Final

import msgspec

from core.ledger.accounts import AccountType
from core.ledger.commands import Posting, PostTransaction
from core.ledger.entries import Origin
from core.ledger.money import format_amount, parse_amount
from core.ledger.reasons import Reason


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
    """The transaction `reverses` was taken back by the opposite transaction `id`, on the same day."""

    id: str
    reverses: str
    entry: str | None
    date: str
    description: str
    postings: tuple[PostingLine, ...]
    v: int = 1


Booking = TransactionPosted | EntryPosted | TransactionReversed
Event = AccountOpened | AccountClosed | Booking

EVENT_VERSION: Final = 1
ENTRY_POSTINGS: Final = 2  # the money, and what it was for
_DECODER: Final = msgspec.json.Decoder(Event)


def posted(command: PostTransaction) -> TransactionPosted:
    """Return the event in which this command comes true."""
    return TransactionPosted(
        command.id, command.date, command.description, command.tags, lines_of(command.postings)
    )


def reversal_of(event: EntryPosted, transaction_id: str) -> TransactionReversed:
    """Return the event that takes the transaction of an entry back."""
    opposite = tuple(
        Posting(posting.account, -posting.amount, posting.currency) for posting in postings_of(event)
    )
    return TransactionReversed(
        transaction_id, event.id, event.entry, event.date, event.description, lines_of(opposite)
    )


def lines_of(postings: tuple[Posting, ...]) -> tuple[PostingLine, ...]:
    """Return postings in the words of an event."""
    return tuple(
        PostingLine(posting.account, format_amount(posting.amount, posting.currency), posting.currency)
        for posting in postings
    )


def postings_of(event: Booking) -> tuple[Posting, ...]:
    """Return the lines of a booked transaction in minor units."""
    return tuple(Posting(line.account, _minor(line), line.currency) for line in event.postings)


def kind_of(event: Event) -> str:
    """Return the kind of an event, as its row and its body name it."""
    return str(event.__struct_config__.tag)


def encode(event: Event) -> bytes:
    """Return the bytes of an event that are hashed and stored."""
    return msgspec.json.encode(event)


def decode(body: bytes) -> Event | None:
    """Return the event in stored bytes, or None if they hold no event that this version knows."""
    try:
        event = _DECODER.decode(body)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    return event if event.v == EVENT_VERSION and _has_readable_lines(event) else None


def _has_readable_lines(event: Event) -> bool:
    if not isinstance(event, Booking):
        return True
    if isinstance(event, EntryPosted) and len(event.postings) != ENTRY_POSTINGS:
        return False
    return all(isinstance(parse_amount(line.amount, line.currency), int) for line in event.postings)


def _minor(line: PostingLine) -> int:
    amount = parse_amount(line.amount, line.currency)
    assert not isinstance(amount, Reason), "a stored event holds an amount that was never one"
    return amount
