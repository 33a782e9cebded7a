"""Drawing: a booking as the tables list it, because its event is left out and is not read.

What has killed a core while it was rebuilt may kill one that reads it for a page as well, so nobody looks into its bytes:
day, text, lines, what it takes back and the entry that stands in it are in the readings that its commit wrote. Tags, the way of
paying and the row of a bank's file stand in the event alone, and are missing. Not chosen: to leave such a booking out of
the lists; balances count it, and a register without it would not add up.
"""

from collections.abc import Container
from typing import Any, Final

from sqlalchemy import Connection, or_, select

from core.journal import schema
from core.journal.shelf import account_of
from core.ledger.events import (
    ENTRY_POSTINGS,
    Booking,
    EntryPosted,
    PendingPosted,
    PostingLine,
    TransactionPending,
    TransactionPosted,
    TransactionReversed,
    decode,
)
from core.ledger.moments import timestamp
from core.ledger.money import format_amount
from core.ledger.overview import category_name

_ENTRY: Final = EntryPosted.__struct_config__.tag
_POSTED: Final = PendingPosted.__struct_config__.tag
_REVERSAL: Final = TransactionReversed.__struct_config__.tag


def booking_of(connection: Connection, seq: int, body: bytes, parked: Container[int]) -> Booking:
    """Return the booking of event `seq`: read from its body, or of one that is left out (`parked`), drawn."""
    if seq in parked:
        return drawn(connection, seq)
    event = decode(body)
    assert isinstance(event, Booking), f"event {seq} is listed as a booking and is none"
    return event


def drawn(connection: Connection, seq: int) -> Booking:
    """Return what is listed of a booking, without a look at its event.

    Of an entry that was changed since, nothing lists which one it was: it is drawn as a bare transaction.
    """
    booking = schema.booking.c
    kind = select(schema.event.c.kind).where(schema.event.c.seq == seq).scalar_subquery()
    row = connection.execute(
        select(booking.id, booking.date, booking.description, kind.label("kind")).where(booking.seq == seq)
    ).one()
    listed = connection.execute(_LINES.where(schema.posting.c.seq == seq)).all()
    lines = tuple(
        PostingLine(line.id, format_amount(line.amount, line.currency), line.currency) for line in listed
    )
    if row.kind == _REVERSAL:
        return _reversal(connection, seq, row, lines)
    if row.kind == _POSTED:
        return _posted(connection, seq, row, lines)
    entry = _entry_in(connection, seq, row.id) if row.kind == _ENTRY else None
    if entry is None:
        return TransactionPosted(row.id, row.date, row.description, (), lines)
    assert len(listed) == ENTRY_POSTINGS, f"entry {seq} is listed with {len(listed)} lines"
    category = category_name(account_of(listed[1]))
    return EntryPosted(row.id, entry, row.date, row.description, (), lines, category, None, None)


def pending_of(connection: Connection, seq: int, body: bytes, parked: Container[int]) -> TransactionPending:
    """Return the pending transaction of event `seq`: read from its body, or of one that is left out, drawn."""
    if seq not in parked:
        event = decode(body)
        assert isinstance(event, TransactionPending), f"event {seq} is listed as pending and is not"
        return event
    row = connection.execute(select(schema.pending).where(schema.pending.c.seq == seq)).one()
    expires_at = timestamp(row.expires_ns) if row.expires_ns is not None else None
    return TransactionPending(row.id, row.date, row.description, (), _held(connection, seq), expires_at)


def _posted(connection: Connection, seq: int, row: Any, lines: tuple[PostingLine, ...]) -> PendingPosted:
    pending = connection.execute(select(schema.pending).where(schema.pending.c.closed_seq == seq)).one()
    held = _held(connection, pending.seq)
    return PendingPosted(row.id, pending.id, row.date, row.description, (), lines, held)


def _held(connection: Connection, seq: int) -> tuple[PostingLine, ...]:
    held = schema.pending_posting.c
    rows = connection.execute(
        select(schema.account.c.id, schema.account.c.currency, held.amount)
        .join_from(schema.pending_posting, schema.account, schema.account.c.id == held.account_id)
        .where(held.seq == seq)
        .order_by(held.line)
    )
    return tuple(PostingLine(row.id, format_amount(row.amount, row.currency), row.currency) for row in rows)


def _reversal(
    connection: Connection, seq: int, row: Any, lines: tuple[PostingLine, ...]
) -> TransactionReversed:
    booking, reversal = schema.booking.c, schema.reversal.c
    query = select(booking.id, booking.seq).join_from(
        schema.reversal, schema.booking, booking.seq == reversal.reversed_seq
    )
    taken = connection.execute(query.where(reversal.seq == seq)).one()
    entry = _entry_in(connection, taken.seq, taken.id)
    return TransactionReversed(row.id, taken.id, entry, row.date, row.description, lines)


def _entry_in(connection: Connection, seq: int, booking_id: str) -> str | None:
    """Return the entry that began with this booking, or that stands in it."""
    entry = schema.entry.c
    query = select(entry.id).where(or_(entry.id == booking_id, entry.seq == seq))
    return connection.execute(query).scalars().first()


_LINES: Final = (
    select(schema.account, schema.posting.c.amount)
    .join_from(schema.posting, schema.account, schema.account.c.id == schema.posting.c.account_id)
    .order_by(schema.posting.c.line)
)
