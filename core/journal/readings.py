"""What the tables list for a range of events, laid beside what the events say.

Every reading but the balances belongs to one event and is compared with it by its number, so a proof of a long
ledger needs no more than a slice in memory. What stands can change later: a posting falls when its transaction
is reversed, an entry moves on to its newest event. Both are judged by the reversals that are listed at the same
moment, and each of those is compared with its own event when the proof comes to it. Of what is pending each end is
compared with the event that has made it, and what it says was released with the lines that were held.
"""

from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import Any, Final

import msgspec
from sqlalchemy import Connection, select

from core.journal import schema
from core.journal.schema_plans import listed_of
from core.ledger.book import PendingState
from core.ledger.events import (
    BalanceAsserted,
    Booking,
    EntryPosted,
    Event,
    PendingExpired,
    PendingPosted,
    PendingVoided,
    Release,
    TransactionPending,
    TransactionReversed,
    asserted_amounts,
    expiry_of,
    postings_of,
    released_by,
)
from core.ledger.plans import PlanEvent

_Line = tuple[str, int, str, int]


class LeftOut(msgspec.Struct, frozen=True):
    """What is listed for an event that nobody reads: the lines that it posted, reserved and released, with their accounts.

    `days`: the day of each line that was posted.
    """

    posted: list[tuple[str, int]]
    reserved: list[tuple[str, int]]
    released: list[tuple[str, int]]
    days: list[str]

    @property
    def accounts(self) -> set[str]:
        """All accounts that are named."""
        return {name for lines in (self.posted, self.reserved, self.released) for name, _ in lines}


class Readings(msgspec.Struct):
    """What is listed for a range of events, by sequence. `take` and `leave_out` remove what they have seen."""

    bookings: dict[int, tuple[str, str, str]]
    postings: dict[int, list[_Line]]
    entries: dict[int, tuple[str, str, str, str, int]]
    reversals: dict[int, str]
    taken_back: dict[int, list[tuple[str, int]]]
    origins: dict[int, str]
    plans: dict[int, tuple[Any, ...]]
    fallen: frozenset[int]
    pendings: dict[int, tuple[str, str, str, int | None]]
    held: dict[int, list[tuple[str, int]]]
    endings: dict[int, tuple[str, str]]
    released: dict[int, list[tuple[str, int]]]
    assertions: dict[int, tuple[str, str, str, int, int, int]]

    def take(self, event: Event, seq: int) -> bool:
        """Whether what is listed for this event is what the event says."""
        fell = seq in self.fallen
        plan = self.plans.pop(seq, None)
        if plan != (listed_of(event) if isinstance(event, PlanEvent) else None):
            return False
        listed = (
            self.bookings.pop(seq, None),
            self.postings.pop(seq, []),
            self.reversals.pop(seq, None),
            self.taken_back.pop(seq, []),
            self.origins.pop(seq, None),
        )
        if listed != _said(event, fell=fell) or self._take_pending(seq) != _said_of_pending(event):
            return False
        return self._take_entry(event, seq, fell=fell)

    def leave_out(self, seq: int) -> LeftOut:
        """Take what is listed for an event that nobody reads, and return what it has moved."""
        rows = self.postings.pop(seq, [])
        left = LeftOut(
            [(account, amount) for account, amount, *_ in rows],
            self.held.pop(seq, []),
            self.released.pop(seq, []),
            [row[2] for row in rows],
        )
        for listed in (
            self.bookings,
            self.entries,
            self.reversals,
            self.taken_back,
            self.origins,
            self.pendings,
            self.endings,
            self.assertions,
            self.plans,
        ):
            listed.pop(seq, None)
        return left

    def left(self) -> list[int]:
        """Return the numbers that are listed and were not taken."""
        return [
            *self.bookings,
            *self.postings,
            *self.entries,
            *self.reversals,
            *self.taken_back,
            *self.origins,
            *self.pendings,
            *self.held,
            *self.endings,
            *self.released,
            *self.assertions,
            *self.plans,
        ]

    def _take_pending(self, seq: int) -> tuple[Any, ...]:
        return (
            self.pendings.pop(seq, None),
            self.held.pop(seq, []),
            self.endings.pop(seq, None),
            self.released.pop(seq, []),
            self.assertions.pop(seq, None),
        )

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

    def whole(table: Any) -> Iterable[Any]:
        return connection.execute(select(table).where(table.c.seq.between(first_seq, last_seq)))

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
        plans={**_by_seq(whole(schema.budget)), **_by_seq(whole(schema.recurring))},
        fallen=frozenset(row.reversed_seq for row in rows(reversal.reversed_seq)),
        **_of_pending(connection, rows, first_seq, last_seq),
    )


def _of_pending(
    connection: Connection, rows: Callable[..., Iterable[Any]], first_seq: int, last_seq: int
) -> dict[str, Any]:
    pending, held, stated = schema.pending.c, schema.pending_posting.c, schema.assertion.c
    released = connection.execute(
        select(pending.closed_seq, held.account_id, held.amount)
        .join_from(schema.pending, schema.pending_posting, held.seq == pending.seq)
        .where(pending.closed_seq.between(first_seq, last_seq), pending.seq < pending.closed_seq)
        .order_by(pending.closed_seq, held.line)
    )
    lines = rows(held.seq, held.account_id, held.amount, held.line)
    said = stated.id, stated.account_id, stated.date, stated.amount, stated.actual, stated.holds
    return {
        "pendings": _by_seq(
            rows(pending.seq, pending.id, pending.date, pending.description, pending.expires_ns)
        ),
        "held": _lists(sorted(lines, key=lambda row: (row[0], row[-1])), lambda row: tuple(row[1:-1])),
        "endings": _by_seq(rows(pending.closed_seq, pending.id, pending.state)),
        "released": _lists(released, lambda row: (row.account_id, row.amount)),
        "assertions": _by_seq(rows(stated.seq, *said)),
    }


def listed_after(connection: Connection, seq: int) -> list[int]:
    """Return the lowest number beyond `seq` that each table lists, if it lists any."""
    columns = (*(table.c.seq for table in _TABLES), schema.pending.c.closed_seq)
    return [
        found
        for column in columns
        for found in connection.execute(
            select(column).where(column > seq).order_by(column).limit(1)
        ).scalars()
    ]


_TABLES: Final = (
    schema.booking,
    schema.posting,
    schema.entry,
    schema.reversal,
    schema.origin,
    schema.pending,
    schema.pending_posting,
    schema.assertion,
    schema.budget,
    schema.recurring,
)


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


def _said_of_pending(event: Event) -> tuple[Any, ...]:
    pending = ending = asserted = None
    held: list[tuple[str, int]] = []
    released: list[tuple[str, int]] = []
    if isinstance(event, TransactionPending):
        pending = (event.id, event.date, event.description, expiry_of(event))
        held = [(posting.account, posting.amount) for posting in postings_of(event)]
    elif isinstance(event, Release):
        ending = (event.pending, _ENDS[type(event)])
        released = [(posting.account, posting.amount) for posting in released_by(event)]
    elif isinstance(event, BalanceAsserted):
        asserted = (event.id, event.account, event.date, *asserted_amounts(event), int(event.holds))
    return pending, held, ending, released, asserted


_ENDS: Final[Mapping[type[Any], str]] = MappingProxyType(
    {
        PendingPosted: PendingState.POSTED.value,
        PendingVoided: PendingState.VOIDED.value,
        PendingExpired: PendingState.EXPIRED.value,
    }
)


def _by_seq(rows: Iterable[Any]) -> dict[int, Any]:
    return {row[0]: tuple(row[1:]) for row in rows}


def _lists(rows: Iterable[Any], made: Callable[[Any], Any]) -> dict[int, list[Any]]:
    lists: dict[int, list[Any]] = {}
    for row in rows:
        lists.setdefault(row[0], []).append(made(row))
    return lists
