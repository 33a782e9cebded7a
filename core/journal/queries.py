"""Reading the book: questions to the store, each short, each at one moment.

Lists go backwards by sequence and a cursor is the sequence last shown, so a page never shifts under new
bookings; an offset would. A transaction is told from its event, not from its readings: the readings find it,
the event is what happened. Only of one that is left out of every rebuild (`parked`) the readings tell (`drawing`).
"""

from collections.abc import Container, Iterable, Iterator, Sequence
from typing import Any, Final

import msgspec
from msgspec import Raw
from sqlalchemy import Connection, func, select, text

from core.journal import schema
from core.journal.attestation import Attestation, Balance, balances_of, pending_move
from core.journal.chain import EventRow
from core.journal.drawing import booking_of, pending_of
from core.journal.proof import Tail, Walk
from core.journal.shelf import VARIABLES_MAX, account_of
from core.journal.store import is_in_server
from core.journal.sums import halves, whole
from core.ledger.accounts import Account, AccountType
from core.ledger.book import PendingState
from core.ledger.events import AccountOpened, BalanceAsserted, decode
from core.ledger.moments import timestamp
from core.ledger.views import (
    AssertionView,
    CommittedEvent,
    EventView,
    Place,
    TransactionView,
    tell,
    view_assertion,
    view_pending,
    view_transaction,
)

ACCOUNTS_MAX: Final = 10_000
_OPENED: Final = AccountOpened.__struct_config__.tag


class TransactionFilter(msgspec.Struct, frozen=True):
    """Which transactions: of an account, between two days (inclusive), with words in the description."""

    account: str | None = None
    date_from: str | None = None
    date_to: str | None = None
    words: str | None = None
    before_seq: int | None = None
    limit: int = 50


def list_accounts(
    connection: Connection, after: str | None, limit: int, types: Sequence[AccountType] | None = None
) -> list[Account]:
    """Return accounts by id, beginning after one of them; `types`: only of these."""
    query = select(schema.account).order_by(schema.account.c.id).limit(limit)
    if after is not None:
        query = query.where(schema.account.c.id > after)
    if types is not None:
        query = query.where(schema.account.c.type.in_([kind.value for kind in types]))
    return [account_of(row) for row in connection.execute(query)]


def first_opened(connection: Connection, records: int, parked: Container[int]) -> list[str]:
    """Return the ids of the accounts that were opened within the first `records` of the ledger, in that order."""
    event = schema.event.c
    query = select(event.seq, event.body).where(event.seq <= records, event.kind == _OPENED)
    rows = connection.execute(query.order_by(event.seq))
    found = (decode(row.body) for row in rows if row.seq not in parked)
    return [one.id for one in found if isinstance(one, AccountOpened)]


def get_account(connection: Connection, account_id: str) -> Account | None:
    """Return one account."""
    row = connection.execute(select(schema.account).where(schema.account.c.id == account_id)).one_or_none()
    return account_of(row) if row else None


def list_transactions(
    connection: Connection, wanted: TransactionFilter, parked: Container[int]
) -> list[TransactionView]:
    """Return transactions, newest first."""
    booking = schema.booking.c
    query = _EVENTS_OF_BOOKINGS.order_by(booking.seq.desc()).limit(wanted.limit)
    if wanted.account is not None:
        of_account = select(schema.posting.c.seq).where(schema.posting.c.account_id == wanted.account)
        query = query.where(booking.seq.in_(of_account))
    if wanted.date_from is not None:
        query = query.where(booking.date >= wanted.date_from)
    if wanted.date_to is not None:
        query = query.where(booking.date <= wanted.date_to)
    if wanted.words is not None:
        query = query.where(booking.description.icontains(wanted.words, autoescape=True))
    if wanted.before_seq is not None:
        query = query.where(booking.seq < wanted.before_seq)
    rows = connection.execute(query).all()
    reversed_by = _reversals(connection, [row.seq for row in rows])
    return [_transaction(connection, row, parked, reversed_by.get(row.seq)) for row in rows]


def list_pendings(
    connection: Connection, parked: Container[int], before_seq: int | None = None, limit: int = 50
) -> list[TransactionView]:
    """Return what is pending and still open, newest first."""
    query = _EVENTS_OF_PENDINGS.where(schema.pending.c.state == "open")
    if before_seq is not None:
        query = query.where(schema.pending.c.seq < before_seq)
    query = query.order_by(schema.pending.c.seq.desc()).limit(limit)
    return [_pending(connection, row, parked) for row in connection.execute(query).all()]


def list_assertions(
    connection: Connection,
    parked: Container[int],
    account: str | None = None,
    before_seq: int | None = None,
    limit: int = 50,
) -> list[AssertionView]:
    """Return what was asserted of balances, newest first; one whose event is left out is not told."""
    asserted, event = schema.assertion.c, schema.event.c
    query = select(event.seq, event.epoch, event.booked_ns, event.hash, event.body).join_from(
        schema.assertion, schema.event, asserted.seq == event.seq
    )
    if account is not None:
        query = query.where(asserted.account_id == account)
    if before_seq is not None:
        query = query.where(asserted.seq < before_seq)
    found = []
    for row in connection.execute(query.order_by(asserted.seq.desc()).limit(limit)):
        made = decode(row.body) if row.seq not in parked else None
        if isinstance(made, BalanceAsserted):
            found.append(view_assertion(made, Place(row.seq, row.epoch, row.booked_ns, row.hash)))
    return found


def get_transaction(
    connection: Connection, transaction_id: str, parked: Container[int]
) -> TransactionView | None:
    """Return one transaction, booked or pending."""
    query = _EVENTS_OF_BOOKINGS.where(schema.booking.c.id == transaction_id)
    row = connection.execute(query).one_or_none()
    if row is not None:
        return _transaction(connection, row, parked, _reversals(connection, [row.seq]).get(row.seq))
    found = connection.execute(_EVENTS_OF_PENDINGS.where(schema.pending.c.id == transaction_id)).one_or_none()
    return _pending(connection, found, parked) if found else None


def list_events(connection: Connection, after_seq: int, limit: int) -> list[EventView]:
    """Return events in order, beginning after a sequence."""
    return [
        EventView(
            seq=row.seq,
            epoch=row.epoch,
            booked_at=timestamp(row.booked_ns),
            kind=row.kind,
            command_id=row.command_id,
            key=row.key,
            hash=row.hash.hex(),
            body=Raw(row.body),
        )
        for row in event_rows(connection, after_seq, limit)
    ]


def committed_after(connection: Connection, after_seq: int, limit: int) -> list[CommittedEvent]:
    """Return what would have been told of the events after a sequence at the time, in order; none is left out."""
    told = []
    for row in event_rows(connection, after_seq, limit):
        event = decode(row.body)
        assert event is not None, (
            f"event {row.seq} can't be read, and a core whose book has one does not start, or has it parked"
        )
        told.append(tell(event, row.seq))
    return told


def known_fingerprints(connection: Connection, fingerprints: Iterable[str]) -> set[str]:
    """Return those rows of bank files that were ever booked, also if they were reversed since."""
    distinct = list(dict.fromkeys(fingerprints))
    known: set[str] = set()
    for start in range(0, len(distinct), VARIABLES_MAX):
        part = distinct[start : start + VARIABLES_MAX]
        query = select(schema.origin.c.fingerprint).where(schema.origin.c.fingerprint.in_(part))
        known |= set(connection.execute(query).scalars())
    return known


def event_rows(connection: Connection, after_seq: int, limit: int | None = None) -> Iterator[EventRow]:
    """Return the events after a sequence, in order."""
    query = select(schema.event).where(schema.event.c.seq > after_seq).order_by(schema.event.c.seq)
    for row in connection.execute(query.limit(limit)):
        yield EventRow(*row)  # its columns in their order: by name it costs a proof half as much again


def event_row(connection: Connection, seq: int) -> EventRow | None:
    """Return one event."""
    return next((row for row in event_rows(connection, seq - 1, 1) if row.seq == seq), None)


def head(connection: Connection) -> Any:
    """Return what the store says of itself: epoch, head_seq, head_hash."""
    return connection.execute(select(schema.meta)).one()


def all_accounts(connection: Connection) -> Iterator[Account]:
    """Return every account, without a bound: for proofs."""
    return (account_of(row) for row in connection.execute(select(schema.account)))


def account_names(connection: Connection) -> set[tuple[str, str]]:
    """Return every folded name with its account, without a bound: for proofs."""
    return {(row.folded, row.account_id) for row in connection.execute(select(schema.account_name))}


def count_entries(connection: Connection) -> int:
    """Return how many entries there are, reversed ones too."""
    return connection.execute(select(func.count()).select_from(schema.entry)).scalar_one()


def began_entry(connection: Connection, seq: int) -> bool:
    """Whether an entry began with this event, seen without reading it."""
    booked = select(schema.booking.c.id).where(schema.booking.c.seq == seq).scalar_subquery()
    query = select(schema.entry.c.id).where(schema.entry.c.id == booked)
    return connection.execute(query).first() is not None


def keys_between(connection: Connection, first_seq: int, last_seq: int | None = None) -> dict[int, str]:
    """Return the keys that name an event in this range (both ends in it), by its sequence."""
    kept = schema.idempotency.c
    query = select(kept.seq, kept.key).where(kept.seq >= first_seq)
    if last_seq is not None:
        query = query.where(kept.seq <= last_seq)
    return {row[0]: row[1] for row in connection.execute(query)}


def moved_between(connection: Connection, first_seq: int, last_seq: int | None = None) -> dict[str, int]:
    """Return what is listed as moved by these events (both ends in the range), by balance, in minor units."""
    posting, held, pending = schema.posting.c, schema.pending_posting.c, schema.pending.c
    query = select(posting.account_id, *halves(posting.amount)).where(
        _is_between(posting.seq, first_seq, last_seq)
    )
    # The plus keeps SQLite from walking a whole index because it is in the order of the accounts.
    by = posting.account_id if is_in_server(connection) else text("+account_id")
    rows = connection.execute(query.group_by(by))
    moved = {row.account_id: whole(row) for row in rows}
    opened = select(held.account_id, held.amount).where(_is_between(held.seq, first_seq, last_seq))
    ended = (
        select(held.account_id, held.amount)
        .join_from(schema.pending, schema.pending_posting, held.seq == pending.seq)
        .where(_is_between(pending.closed_seq, first_seq, last_seq))
    )
    for lines, sign in ((opened, 1), (ended, -1)):
        for account_id, amount in connection.execute(lines):
            name, change = pending_move(account_id, amount)
            moved[name] = moved.get(name, 0) + sign * change
    return moved


def balances(connection: Connection) -> list[Balance]:
    """Return every balance, without a bound: for proofs."""
    account = schema.account.c
    columns = account.id, account.currency, account.posted, account.pending_debit, account.pending_credit
    rows = connection.execute(select(*columns))
    return [balance for row in rows for balance in balances_of(*row)]


def asserted_accounts(connection: Connection) -> list[str]:
    """Return the accounts of which something is asserted, without a bound: for proofs."""
    return list(connection.execute(select(schema.assertion.c.account_id).distinct()).scalars())


def due_pendings(connection: Connection, now_ns: int, limit: int) -> list[str]:
    """Return the ids of pending transactions that have run out by a wall time and are still open, oldest first."""
    pending = schema.pending.c
    query = select(pending.id).where(pending.state == "open", pending.expires_ns <= now_ns)
    return list(connection.execute(query.order_by(pending.expires_ns).limit(limit)).scalars())


def _is_between(column: Any, first_seq: int, last_seq: int | None) -> Any:
    return column >= first_seq if last_seq is None else column.between(first_seq, last_seq)


def newest_attestation(connection: Connection) -> Attestation | None:
    """Return what was attested last; None in a book that has no attestation yet."""
    if not _attests(connection):
        return None
    attested = schema.attestation
    row = connection.execute(select(attested).order_by(attested.c.seq.desc()).limit(1)).one_or_none()
    return Attestation(*row) if row else None


def attestations_between(connection: Connection, first_seq: int, last_seq: int) -> dict[int, Attestation]:
    """Return the attestations of the events of this range, both ends in it, by number."""
    if not _attests(connection):
        return {}
    attested = schema.attestation
    rows = connection.execute(select(attested).where(attested.c.seq.between(first_seq, last_seq)))
    return {row.seq: Attestation(*row) for row in rows}


def _attests(connection: Connection) -> bool:
    """Whether this book has a place for attestations: one of an older version, read as it stands, has none."""
    version: int = connection.execute(select(schema.meta.c.schema_version)).scalar_one()
    return version >= schema.SCHEMA_VERSION_ATTESTED


def read_tail(connection: Connection, walk: Walk, also: Iterable[int]) -> Tail:
    """Return what proof A looks at, from where a walk has come. To be read and used inside one transaction.

    `also`: the numbers of events whose hashes are asked for.
    """
    meta = head(connection)
    asked = (event_row(connection, seq) for seq in sorted({walk.seq, *also}))
    return Tail(
        head_seq=meta.head_seq,
        head_hash=meta.head_hash,
        epoch=meta.epoch,
        walk=walk,
        hashes={row.seq: row.hash for row in asked if row is not None},
        rows=event_rows(connection, walk.seq),
        keys=keys_between(connection, walk.seq + 1),
        moved=moved_between(connection, walk.seq + 1),
        balances=balances(connection),
    )


_EVENTS_OF_BOOKINGS: Final = select(
    schema.event.c.seq,
    schema.event.c.epoch,
    schema.event.c.booked_ns,
    schema.event.c.hash,
    schema.event.c.body,
).join_from(schema.booking, schema.event, schema.booking.c.seq == schema.event.c.seq)


def _transaction(
    connection: Connection, row: Any, parked: Container[int], reversed_by: str | None
) -> TransactionView:
    event = booking_of(connection, row.seq, row.body, parked)
    place = Place(row.seq, row.epoch, row.booked_ns, row.hash)
    return view_transaction(event, place, set_aside=row.seq in parked, reversed_by=reversed_by)


def _reversals(connection: Connection, seqs: Sequence[int]) -> dict[int, str]:
    """Return the transactions that take these back, by the number of what they take back."""
    reversal, booking = schema.reversal.c, schema.booking.c
    query = (
        select(reversal.reversed_seq, booking.id)
        .join_from(schema.reversal, schema.booking, booking.seq == reversal.seq)
        .where(reversal.reversed_seq.in_(seqs))
    )
    return {row.reversed_seq: row.id for row in connection.execute(query)}


_EVENTS_OF_PENDINGS: Final = (
    select(
        schema.event.c.seq,
        schema.event.c.epoch,
        schema.event.c.booked_ns,
        schema.event.c.hash,
        schema.event.c.body,
        schema.pending.c.state,
        schema.booking.c.id.label("posted_by"),
    )
    .join_from(schema.pending, schema.event, schema.pending.c.seq == schema.event.c.seq)
    .outerjoin(schema.booking, schema.booking.c.seq == schema.pending.c.closed_seq)
)


def _pending(connection: Connection, row: Any, parked: Container[int]) -> TransactionView:
    event = pending_of(connection, row.seq, row.body, parked)
    return view_pending(
        event,
        Place(row.seq, row.epoch, row.booked_ns, row.hash),
        PendingState(row.state),
        posted_by=row.posted_by,
        set_aside=row.seq in parked,
    )
