"""What the tables list for a range of events, laid beside what the events say.

Every reading but the balances belongs to one event and is compared with it by its number, so a proof of a long
ledger needs no more than a slice in memory. What stands can change later: a posting falls when its transaction
is reversed, an entry moves on to its newest event. Both are judged by the reversals that are listed at the same
moment, and each of those is compared with its own event when the proof comes to it.
"""

from collections.abc import Callable, Iterable
from typing import Any, Final

import msgspec
from sqlalchemy import Connection, select

from core.journal import schema
from core.ledger.events import Booking, EntryPosted, Event, TransactionReversed, postings_of

_Line = tuple[str, int, str, int]


class Readings(msgspec.Struct):
    """What is listed for a range of events, by sequence. `take` and `leave_out` remove what they have seen."""

    bookings: dict[int, tuple[str, str, str]]
    postings: dict[int, list[_Line]]
    entries: dict[int, tuple[str, str, str, str, int]]
    reversals: dict[int, str]
    taken_back: dict[int, list[tuple[str, int]]]
    origins: dict[int, str]
    fallen: frozenset[int]

    def take(self, event: Event, seq: int) -> bool:
        """Whether what is listed for this event is what the event says."""
        fell = seq in self.fallen
        listed = (
            self.bookings.pop(seq, None),
            self.postings.pop(seq, []),
            self.reversals.pop(seq, None),
            self.taken_back.pop(seq, []),
            self.origins.pop(seq, None),
        )
        return listed == _said(event, fell=fell) and self._take_entry(event, seq, fell=fell)

    def leave_out(self, seq: int) -> list[tuple[str, int]]:
        """Take what is listed for an event that nobody reads; return what it posted to which account."""
        lines = [(account, amount) for account, amount, *_ in self.postings.pop(seq, [])]
        for listed in (self.bookings, self.entries, self.reversals, self.taken_back, self.origins):
            listed.pop(seq, None)
        return lines

    def left(self) -> list[int]:
        """Return the numbers that are listed and were not taken."""
        return [
            *self.bookings,
            *self.postings,
            *self.entries,
            *self.reversals,
            *self.taken_back,
            *self.origins,
        ]

    def _take_entry(self, event: Event, seq: int, *, fell: bool) -> bool:
        listed = self.entries.pop(seq, None)
        if not isinstance(event, EntryPosted):
            return listed is None
        if fell and listed is None:
            return True  # something else was booked in its place, and is listed there
        money, category = event.postings
        return listed == (event.entry, event.date, money.account, category.account, int(fell))


def read_between(connection: Connection, first_seq: int, last_seq: int) -> Readings:
    """Return what is listed for the events of this range, both ends in it."""
    booking, posting, entry = schema.booking.c, schema.posting.c, schema.entry.c
    reversal, origin = schema.reversal.c, schema.origin.c

    def rows(column: Any, *columns: Any) -> Iterable[Any]:
        query = select(column, *columns).where(column.between(first_seq, last_seq))
        return connection.execute(query.order_by(column))

    lines = rows(
        posting.seq, posting.account_id, posting.amount, posting.date, posting.standing, posting.line
    )
    reversed_ids = connection.execute(
        select(reversal.seq, booking.id)
        .join_from(schema.reversal, schema.booking, reversal.reversed_seq == booking.seq)
        .where(reversal.seq.between(first_seq, last_seq), reversal.reversed_seq < reversal.seq)
    )
    taken_back = connection.execute(
        select(reversal.seq, posting.account_id, posting.amount)
        .join_from(schema.reversal, schema.posting, reversal.reversed_seq == posting.seq)
        .where(reversal.seq.between(first_seq, last_seq))
        .order_by(reversal.seq, posting.line)
    )
    return Readings(
        bookings=_by_seq(rows(booking.seq, booking.id, booking.date, booking.description)),
        postings=_lists(sorted(lines, key=lambda row: (row[0], row[-1])), lambda row: tuple(row[1:-1])),
        entries=_by_seq(
            rows(entry.seq, entry.id, entry.date, entry.account_id, entry.category_id, entry.reversed)
        ),
        reversals={row.seq: row.id for row in reversed_ids},
        taken_back=_lists(taken_back, lambda row: (row.account_id, -row.amount)),
        origins={row.seq: row.fingerprint for row in rows(origin.seq, origin.fingerprint)},
        fallen=frozenset(row.reversed_seq for row in rows(reversal.reversed_seq)),
    )


def listed_after(connection: Connection, seq: int) -> list[int]:
    """Return the lowest number beyond `seq` that each table lists, if it lists any."""
    return [
        found
        for table in _TABLES
        for found in connection.execute(
            select(table.c.seq).where(table.c.seq > seq).order_by(table.c.seq).limit(1)
        ).scalars()
    ]


_TABLES: Final = (schema.booking, schema.posting, schema.entry, schema.reversal, schema.origin)


def _said(event: Event, *, fell: bool) -> tuple[Any, ...]:
    if not isinstance(event, Booking):
        return None, [], None, [], None
    is_reversal = isinstance(event, TransactionReversed)
    lines = [(posting.account, posting.amount) for posting in postings_of(event)]
    standing = int(not fell and not is_reversal)
    return (
        (event.id, event.date, event.description),
        [(*line, event.date, standing) for line in lines],
        event.reverses if isinstance(event, TransactionReversed) else None,
        lines if is_reversal else [],
        event.origin.fingerprint if isinstance(event, EntryPosted) and event.origin else None,
    )


def _by_seq(rows: Iterable[Any]) -> dict[int, Any]:
    return {row[0]: tuple(row[1:]) for row in rows}


def _lists(rows: Iterable[Any], made: Callable[[Any], Any]) -> dict[int, list[Any]]:
    lists: dict[int, list[Any]] = {}
    for row in rows:
        lists.setdefault(row[0], []).append(made(row))
    return lists
