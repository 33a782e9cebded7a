"""Events: what has happened to the book, in the words it is kept in for ever.

Each kind carries the version of its shape, and its amounts are decimal strings with the currency's digits: an
event can be read and added up in fifty years by somebody who has neither this program nor its table of
exponents. The bytes made here are what the chain hashes and what the store keeps; nothing ever encodes an
event a second time. Deltas or plain rows were not chosen: the event is the truth, every table is a reading.
"""

from typing import Final

import msgspec

from core.ledger.accounts import AccountType
from core.ledger.commands import Posting, PostTransaction
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


Event = AccountOpened | AccountClosed | TransactionPosted

EVENT_VERSION: Final = 1
_DECODER: Final = msgspec.json.Decoder(Event)


def posted(command: PostTransaction) -> TransactionPosted:
    """Return the event in which this command comes true."""
    lines = tuple(
        PostingLine(posting.account, format_amount(posting.amount, posting.currency), posting.currency)
        for posting in command.postings
    )
    return TransactionPosted(command.id, command.date, command.description, command.tags, lines)


def postings_of(event: TransactionPosted) -> tuple[Posting, ...]:
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
    readable = event.v == EVENT_VERSION and (
        not isinstance(event, TransactionPosted)
        or all(isinstance(parse_amount(line.amount, line.currency), int) for line in event.postings)
    )
    return event if readable else None


def _minor(line: PostingLine) -> int:
    amount = parse_amount(line.amount, line.currency)
    assert not isinstance(amount, Reason), "a stored event holds an amount that was never one"
    return amount
