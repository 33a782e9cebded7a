"""What a batch may touch, fetched before it is decided: its part of the book, and its keys.

A few SELECTs per batch, each for all its commands together, inside the transaction that writes them. Names come
before ids, because a command that names a category can't say which account that is until the currency of its
money is known. What is fetched is always enough and may be too much: deciding sees what exists, never the store.
A book that reads from the store while it is asked was not chosen: deciding would no longer be a pure function.
"""

from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from typing import Any, Final

from sqlalchemy import Connection, bindparam, select

from core.journal import schema
from core.journal.answers import KeyRow, Order, Work, keys_of
from core.journal.sums import halves, whole
from core.ledger.accounts import Account, AccountType
from core.ledger.book import Book, KnownBooking, KnownEntry, KnownPending, PendingState, ids_for
from core.ledger.commands import (
    AssertBalance,
    Command,
    ExpirePending,
    OpenAccount,
    PostPending,
    ReverseTransaction,
    VoidPending,
)
from core.ledger.entries import EntryDetails, RecordEntry, ReplaceEntry, ReverseEntry
from core.ledger.events import Booking, EntryPosted, TransactionPending, decode, postings_of
from core.ledger.fields import folded
from core.ledger.household import CATEGORY_TYPES, MONEY_TYPES
from core.ledger.plans import EndRecurring, KnownRecurring, RecurringSet, SetRecurring

PLACE_DIGITS: Final = 4  # of a part of a request, behind its key
VARIABLES_MAX: Final = 20_000  # names asked for in one SELECT, below SQLite's limit of 32,766


def fetch_keys(connection: Connection, works: Sequence[Work]) -> dict[str, KeyRow]:
    """Return what the store keeps under the keys of a batch."""
    keys: dict[str, KeyRow] = {}
    for part in _parts(keys_of(works)):
        for row in connection.execute(_KEYS, {"names": part}):
            keys[row.key] = KeyRow(row.fingerprint, row.seq, row.status, row.reply, row.digest)
    return keys


def epoch_of(connection: Connection) -> int:
    """Return the epoch of the store."""
    epoch: int = connection.execute(select(schema.meta.c.epoch)).scalar_one()
    return epoch


def read_key(connection: Connection, key: str) -> tuple[int, KeyRow | None]:
    """Return the store's epoch and what it keeps under a key, both at one moment."""
    epoch = epoch_of(connection)
    for row in connection.execute(_KEYS, {"names": [key]}):
        return epoch, KeyRow(row.fingerprint, row.seq, row.status, row.reply, row.digest)
    return epoch, None


def read_parts(connection: Connection, key: str, digest: bytes | None) -> dict[int, KeyRow]:
    """Return what the store keeps under the parts of a key (`KEY:0017`), by their places.

    `digest`: only those of this request.
    """
    kept = schema.idempotency.c
    query = select(schema.idempotency).where(kept.key >= f"{key}:", kept.key < f"{key};")
    found: dict[int, KeyRow] = {}
    for row in connection.execute(query if digest is None else query.where(kept.digest == digest)):
        place = row.key.removeprefix(f"{key}:")
        if len(place) == PLACE_DIGITS and place.isascii() and place.isdigit():
            found[int(place)] = KeyRow(row.fingerprint, row.seq, row.status, row.reply, row.digest)
    return found


def fetch_book(connection: Connection, orders: Sequence[Order]) -> Book:
    """Return everything of the book that the commands of a batch may touch."""
    commands = [order.command for order in orders]
    book = Book()
    for part in _parts(name for command in commands for name in _entry_of(command)):
        for row in connection.execute(_ENTRIES, {"names": part}):
            book.entries[row.id] = _known(row)
    _take_transactions(connection, book, commands)
    events: list[Booking | TransactionPending] = [known.event for known in book.entries.values()]
    events.extend(known.event for known in book.bookings.values())
    events.extend(known.event for known in book.pendings.values())
    booked = (posting.account for event in events for posting in postings_of(event))
    named = (name for order in orders for name in order.account_ids)
    _take_accounts(connection, book, _BY_ID, (*booked, *named))
    details = [made for command in commands for made in _details_of(command)]
    if details:
        _take_accounts(connection, book, _BY_NAME, _names(details))
        _take_accounts(connection, book, _BY_ID, _ids_of_first_use(details, commands, book))
    for part in _parts(mark for command in commands for mark in _fingerprint_of(command)):
        book.fingerprints |= set(connection.execute(_FINGERPRINTS, {"names": part}).scalars())
    _take_recurrings(connection, book, commands)
    for command in commands:
        if isinstance(command, AssertBalance):
            book.dated[command.account, command.date] = stood_at(connection, command.account, command.date)
    return book


def stood_at(connection: Connection, account_id: str, date: str) -> int:
    """Return what stands on an account for a day and all days before it, in minor units."""
    row = connection.execute(_STOOD, {"account_id": account_id, "date": date}).one()
    return whole(row)


def parked_orders(connection: Connection, orders: Sequence[Order], parked: Container[int]) -> dict[str, int]:
    """Return the commands of a batch that would begin with reading one of these events, by the id of each command.

    Those change an entry, reverse a transaction or end a pending one that stands in such an event; none is read here.
    """
    places: tuple[tuple[Any, Callable[[Command], tuple[str, ...]]], ...] = (
        (_PLACES, _entry_of),
        (_BOOKED_AT, _reversed_by),
        (_PENDING_AT, _transactions_of),
        (_RECURRING_AT, _recurring_of),
    )
    found: dict[str, int] = {}
    for query, named in places:
        seqs: dict[str, int] = {}
        for part in _parts(name for order in orders for name in named(order.command)):
            seqs.update((row.id, row.seq) for row in connection.execute(query, {"names": part}))
        for order in orders:
            for name in named(order.command):
                if name in seqs and seqs[name] in parked:
                    found[order.command_id] = seqs[name]
    return found


def account_of(row: Any) -> Account:
    """Return the account in a row of the table of accounts."""
    return Account(
        row.id,
        row.name,
        AccountType(row.type),
        row.currency,
        bool(row.no_overdraft),
        row.posted,
        bool(row.closed),
        row.pending_debit,
        row.pending_credit,
        row.version,
    )


def _take_accounts(connection: Connection, book: Book, query: Any, names: Iterable[str]) -> None:
    for part in _parts(names):
        for row in connection.execute(query, {"names": part}):
            book.put(account_of(row))


def _take_transactions(connection: Connection, book: Book, commands: Sequence[Command]) -> None:
    """Take in the transactions that are to be reversed, and the pending ones that are to end."""
    for part in _parts(name for command in commands for name in _reversed_by(command)):
        for row in connection.execute(_BOOKED, {"names": part}):
            book.bookings[row.id] = _known_booking(row)
    for part in _parts(name for command in commands for name in _transactions_of(command)):
        for found in connection.execute(_PENDINGS, {"names": part}):
            book.pendings[found.id] = _known_pending(found)


def _known_booking(row: Any) -> KnownBooking:
    event = decode(row.body)
    assert isinstance(event, Booking), f"event {row.seq} is listed as a booking and is none"
    return KnownBooking(row.seq, event, row.reversed_seq is not None)


def _known_pending(row: Any) -> KnownPending:
    event = decode(row.body)
    assert isinstance(event, TransactionPending), f"event {row.seq} is listed as pending and is not"
    return KnownPending(row.seq, event, PendingState(row.state), row.closed_seq)


def _take_recurrings(connection: Connection, book: Book, commands: Sequence[Command]) -> None:
    """Take in the recurring items that are to be changed or ended; what is left out of every rebuild is not read."""
    for item in dict.fromkeys(name for command in commands for name in _recurring_of(command)):
        known = recurring_of(connection, item)
        if known is not None:
            book.recurrings[item] = known


def recurring_of(connection: Connection, item_id: str, parked: Container[int] = ()) -> KnownRecurring | None:
    """Return a recurring item as it stands: what was said of it last, and whether it has ended."""
    rows = connection.execute(_RECURRING, {"id": item_id}).all()
    said = next((row for row in rows if not row.ended and row.seq not in parked), None)
    if said is None:
        return None
    event = decode(said.body)
    assert isinstance(event, RecurringSet), f"event {said.seq} is listed as a recurring item and is none"
    return KnownRecurring(said.seq, event, bool(rows[0].ended))


def _recurring_of(command: Command) -> tuple[str, ...]:
    """Return the recurring item that a command changes or ends."""
    if isinstance(command, SetRecurring):
        return () if command.is_new else (command.id,)
    return (command.id,) if isinstance(command, EndRecurring) else ()


def _reversed_by(command: Command) -> tuple[str, ...]:
    return (command.id,) if isinstance(command, ReverseTransaction) else ()


def _transactions_of(command: Command) -> tuple[str, ...]:
    """Return the pending transactions that a command may meet: what is to be reversed may be none yet."""
    if isinstance(command, PostPending | VoidPending | ExpirePending):
        return (command.pending,)
    return _reversed_by(command)


def _known(row: Any) -> KnownEntry:
    event = decode(row.body)
    assert isinstance(event, EntryPosted), f"event {row.seq} is listed as an entry and is none"
    return KnownEntry(row.seq, event, bool(row.reversed))


def _entry_of(command: Command) -> tuple[str, ...]:
    return (command.entry,) if isinstance(command, ReplaceEntry | ReverseEntry) else ()


def _details_of(command: Command) -> tuple[EntryDetails, ...]:
    return (command.details,) if isinstance(command, RecordEntry | ReplaceEntry) else ()


def _fingerprint_of(command: Command) -> tuple[str, ...]:
    if not isinstance(command, RecordEntry) or command.origin is None:
        return ()
    return (command.origin.fingerprint,)


def _names(details: Iterable[EntryDetails]) -> Iterator[str]:
    for made in details:
        for name in (made.category, made.payment_method if made.account is None else None):
            if name is not None:
                yield folded(name)


def _ids_of_first_use(
    details: Sequence[EntryDetails], commands: Sequence[Command], book: Book
) -> Iterator[str]:
    """Name every id that an account made by these commands may get, so that one which is taken is seen."""
    opened = {command.currency for command in commands if isinstance(command, OpenAccount)}
    given = {made.currency for made in details if made.currency is not None}
    seen = sorted(opened | given | {account.currency for account in book.accounts.values()})
    for name, types, currencies in dict.fromkeys(_first_uses(details, book, tuple(seen))):
        for kind in types:
            for currency in currencies:
                yield from ids_for(name, kind, currency)


def _first_uses(
    details: Sequence[EntryDetails], book: Book, seen: tuple[str, ...]
) -> Iterator[tuple[str | None, tuple[AccountType, ...], tuple[str, ...]]]:
    for made in details:
        account = book.accounts.get(made.account) if made.account is not None else None
        # Where neither the entry nor the store says it, its account is opened or found in this very batch.
        currency = made.currency or (account.currency if account is not None else None)
        currencies = (currency,) if currency is not None else seen
        yield made.category, CATEGORY_TYPES, currencies
        if made.account is None:
            yield made.payment_method, MONEY_TYPES, currencies


def _parts(names: Iterable[str]) -> Iterator[list[str]]:
    # A path may name what no ledger holds, and a server takes no text with a NUL in it: nobody is called that.
    distinct = [name for name in dict.fromkeys(names) if "\0" not in name]
    return (distinct[start : start + VARIABLES_MAX] for start in range(0, len(distinct), VARIABLES_MAX))


_KEYS: Final = select(schema.idempotency).where(
    schema.idempotency.c.key.in_(bindparam("names", expanding=True))
)
_BY_ID: Final = select(schema.account).where(schema.account.c.id.in_(bindparam("names", expanding=True)))
_BY_NAME: Final = (
    select(schema.account)
    .join(schema.account_name, schema.account_name.c.account_id == schema.account.c.id)
    .where(schema.account_name.c.folded.in_(bindparam("names", expanding=True)))
)
_ENTRIES: Final = (
    select(schema.entry.c.id, schema.entry.c.reversed, schema.event.c.seq, schema.event.c.body)
    .join(schema.event, schema.event.c.seq == schema.entry.c.seq)
    .where(schema.entry.c.id.in_(bindparam("names", expanding=True)))
)
_PLACES: Final = select(schema.entry.c.id, schema.entry.c.seq).where(
    schema.entry.c.id.in_(bindparam("names", expanding=True))
)
_FINGERPRINTS: Final = select(schema.origin.c.fingerprint).where(
    schema.origin.c.fingerprint.in_(bindparam("names", expanding=True))
)
_BOOKED: Final = (
    select(schema.booking.c.id, schema.event.c.seq, schema.event.c.body, schema.reversal.c.reversed_seq)
    .join_from(schema.booking, schema.event, schema.event.c.seq == schema.booking.c.seq)
    .outerjoin(schema.reversal, schema.reversal.c.reversed_seq == schema.booking.c.seq)
    .where(schema.booking.c.id.in_(bindparam("names", expanding=True)))
)
_BOOKED_AT: Final = select(schema.booking.c.id, schema.booking.c.seq).where(
    schema.booking.c.id.in_(bindparam("names", expanding=True))
)
_PENDINGS: Final = (
    select(
        schema.pending.c.id,
        schema.pending.c.state,
        schema.pending.c.closed_seq,
        schema.event.c.seq,
        schema.event.c.body,
    )
    .join_from(schema.pending, schema.event, schema.event.c.seq == schema.pending.c.seq)
    .where(schema.pending.c.id.in_(bindparam("names", expanding=True)))
)
_RECURRING: Final = (
    select(schema.recurring.c.seq, schema.recurring.c.ended, schema.event.c.body)
    .join_from(schema.recurring, schema.event, schema.event.c.seq == schema.recurring.c.seq)
    .where(schema.recurring.c.id == bindparam("id"))
    .order_by(schema.recurring.c.seq.desc())
)
_RECURRING_AT: Final = (
    select(schema.recurring.c.id, schema.recurring.c.seq)
    .where(schema.recurring.c.id.in_(bindparam("names", expanding=True)), schema.recurring.c.ended == 0)
    .order_by(schema.recurring.c.seq)
)
_PENDING_AT: Final = select(schema.pending.c.id, schema.pending.c.seq).where(
    schema.pending.c.id.in_(bindparam("names", expanding=True))
)
_STOOD: Final = select(*halves(schema.posting.c.amount)).where(
    schema.posting.c.standing == 1,
    schema.posting.c.account_id == bindparam("account_id"),
    schema.posting.c.date <= bindparam("date"),
)
