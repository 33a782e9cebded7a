"""Reading what is pending: what still waits, and what became of what no longer does.

As with what is booked, a transaction is told from its event, and the tables find it. Of one whose event is left out of
every rebuild the tables alone tell; tags and the moment of its end stand in the event and are missing then.
"""

from collections.abc import Container
from typing import Any, Final

from sqlalchemy import Connection, select

from core.journal import schema
from core.journal.queries import TransactionFilter
from core.ledger.book import PendingState
from core.ledger.events import PostingLine, TransactionPending, decode
from core.ledger.money import format_amount
from core.ledger.views import Place, TransactionView, view_pending


def list_pendings(
    connection: Connection, wanted: TransactionFilter, parked: Container[int]
) -> list[TransactionView]:
    """Return the transactions that still wait, newest first."""
    pending, line = schema.pending.c, schema.pending_posting.c
    query = _PENDINGS.where(pending.state == PendingState.OPEN.value)
    query = query.order_by(pending.seq.desc()).limit(wanted.limit)
    if wanted.account is not None:
        query = query.where(pending.seq.in_(select(line.seq).where(line.account_id == wanted.account)))
    if wanted.date_from is not None:
        query = query.where(pending.date >= wanted.date_from)
    if wanted.date_to is not None:
        query = query.where(pending.date <= wanted.date_to)
    if wanted.words is not None:
        query = query.where(pending.description.icontains(wanted.words, autoescape=True))
    if wanted.before_seq is not None:
        query = query.where(pending.seq < wanted.before_seq)
    return [_view(connection, row, parked) for row in connection.execute(query)]


def get_pending(connection: Connection, pending_id: str, parked: Container[int]) -> TransactionView | None:
    """Return a transaction that was made pending, with what became of it."""
    row = connection.execute(_PENDINGS.where(schema.pending.c.id == pending_id)).one_or_none()
    return _view(connection, row, parked) if row else None


def _view(connection: Connection, row: Any, parked: Container[int]) -> TransactionView:
    set_aside = row.seq in parked
    event = _drawn(connection, row) if set_aside else decode(row.body)
    assert isinstance(event, TransactionPending), f"event {row.seq} is listed as pending and is not"
    place = Place(row.seq, row.epoch, row.booked_ns, row.hash)
    state = PendingState(row.state)
    return view_pending(event, place, state, posted_by=row.posted_by, set_aside=set_aside)


def _drawn(connection: Connection, row: Any) -> TransactionPending:
    line, account = schema.pending_posting.c, schema.account.c
    listed = connection.execute(
        select(line.account_id, line.amount, account.currency)
        .join_from(schema.pending_posting, schema.account, account.id == line.account_id)
        .where(line.seq == row.seq)
        .order_by(line.line)
    )
    lines = tuple(
        PostingLine(one.account_id, format_amount(one.amount, one.currency), one.currency) for one in listed
    )
    return TransactionPending(row.id, row.date, row.description, (), lines, None)


_PENDINGS: Final = (
    select(
        schema.pending.c.id,
        schema.pending.c.date,
        schema.pending.c.description,
        schema.pending.c.state,
        schema.booking.c.id.label("posted_by"),
        schema.event.c.seq,
        schema.event.c.epoch,
        schema.event.c.booked_ns,
        schema.event.c.hash,
        schema.event.c.body,
    )
    .join_from(schema.pending, schema.event, schema.event.c.seq == schema.pending.c.seq)
    .outerjoin(schema.booking, schema.booking.c.seq == schema.pending.c.closed_seq)
)
