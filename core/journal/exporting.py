"""What an export reads: the book as it stood after one event, in slices that each see one short moment.

Events up to a number never change, so the slices fit together however much is booked between them; what is taken from
the tables (the accounts and their names) is read once, in the moment that fixes the number. An event that is left out of
every rebuild is drawn from the readings, as everywhere.
"""

from collections.abc import Container, Mapping, Sequence
from typing import Any, Final

import msgspec
from sqlalchemy import Connection, func, select

from core.journal import queries, schema
from core.journal.drawing import booking_of
from core.ledger.accounts import Account
from core.ledger.events import Booking, EntryPosted
from core.ledger.views import Place, TransactionView, view_transaction

SLICE_BOOKINGS: Final = 500
PENDINGS_MAX: Final = 1_000


class Moment(msgspec.Struct, frozen=True):
    """The moment an export is of: the last event in it, the epoch, the accounts by id, and the first and last day booked on.

    The days are None in a book in which nothing was booked. `pendings`: what waits, the newest of it.
    """

    seq: int
    epoch: int
    accounts: Mapping[str, Account]
    first_day: str | None
    last_day: str | None
    pendings: Sequence[TransactionView] = ()


class Exported(msgspec.Struct, frozen=True):
    """One booked transaction. `category` and `payment_method` are those of a household's entry, as they were given."""

    seen: TransactionView
    category: str | None
    payment_method: str | None


def moment(connection: Connection, parked: Container[int] = ()) -> Moment:
    """Return the present moment of the book."""
    head = queries.head(connection)
    days = connection.execute(select(func.min(schema.booking.c.date), func.max(schema.booking.c.date))).one()
    accounts = {account.id: account for account in queries.all_accounts(connection)}
    waiting = queries.list_pendings(connection, parked, limit=PENDINGS_MAX)
    return Moment(head.head_seq, head.epoch, accounts, *days, waiting)


def slice_after(
    connection: Connection, after_seq: int, until_seq: int, parked: Container[int]
) -> list[Exported]:
    """Return the next transactions after an event, in the order of the book; none: `until_seq` is reached."""
    booking, event = schema.booking.c, schema.event.c
    query = (
        select(event.seq, event.epoch, event.booked_ns, event.hash, event.body)
        .join_from(schema.booking, schema.event, booking.seq == event.seq)
        .where(booking.seq > after_seq, booking.seq <= until_seq)
        .order_by(booking.seq)
        .limit(SLICE_BOOKINGS)
    )
    return [
        _exported(booking_of(connection, row.seq, row.body, parked), row, set_aside=row.seq in parked)
        for row in connection.execute(query).all()
    ]


def _exported(event: Booking, row: Any, *, set_aside: bool) -> Exported:
    place = Place(row.seq, row.epoch, row.booked_ns, row.hash)
    of_entry = event if isinstance(event, EntryPosted) else None
    return Exported(
        view_transaction(event, place, set_aside=set_aside),
        of_entry.category if of_entry else None,
        of_entry.payment_method if of_entry else None,
    )
