"""What a batch may touch, fetched before it is decided: its part of the book, and its keys.

A few SELECTs per batch, each for all its commands together, inside the transaction that writes them. Names come
before ids, because a command that names a category can't say which account that is until the currency of its
money is known. What is fetched is always enough and may be too much: deciding sees what exists, never the store.
A book that reads from the store while it is asked was not chosen: deciding would no longer be a pure function.
"""

from collections.abc import Container, Iterable, Iterator, Sequence
from typing import Any, Final

from sqlalchemy import Connection, bindparam, select

from core.journal import schema
from core.journal.answers import KeyRow, Order, Work
from core.ledger.accounts import Account, AccountType
from core.ledger.book import Book, KnownEntry, ids_for
from core.ledger.commands import Command, OpenAccount
from core.ledger.entries import EntryDetails, RecordEntry, ReplaceEntry, ReverseEntry
from core.ledger.events import EntryPosted, decode, postings_of
from core.ledger.fields import folded
from core.ledger.household import CATEGORY_TYPES, MONEY_TYPES

VARIABLES_MAX: Final = 20_000  # names asked for in one SELECT, below SQLite's limit of 32,766


def fetch_keys(connection: Connection, works: Sequence[Work]) -> dict[str, KeyRow]:
    """Return what the store keeps under the keys of a batch."""
    keys: dict[str, KeyRow] = {}
    for part in _parts(work.key for work in works if work.key is not None):
        for row in connection.execute(_KEYS, {"names": part}):
            keys[row.key] = KeyRow(row.fingerprint, row.seq, row.status, row.reply, row.digest)
    return keys


def read_key(connection: Connection, key: str) -> tuple[int, KeyRow | None]:
    """Return the store's epoch and what it keeps under a key, both at one moment."""
    epoch: int = connection.execute(select(schema.meta.c.epoch)).scalar_one()
    for row in connection.execute(_KEYS, {"names": [key]}):
        return epoch, KeyRow(row.fingerprint, row.seq, row.status, row.reply, row.digest)
    return epoch, None


def fetch_book(connection: Connection, works: Sequence[Work]) -> Book:
    """Return everything of the book that the commands of a batch may touch."""
    orders = [work for work in works if isinstance(work, Order)]
    commands = [order.command for order in orders]
    book = Book()
    for part in _parts(name for command in commands for name in _entry_of(command)):
        for row in connection.execute(_ENTRIES, {"names": part}):
            book.entries[row.id] = _known(row)
    booked = (posting.account for known in book.entries.values() for posting in postings_of(known.event))
    named = (name for order in orders for name in order.account_ids)
    _take_accounts(connection, book, _BY_ID, (*booked, *named))
    details = [made for command in commands for made in _details_of(command)]
    if details:
        _take_accounts(connection, book, _BY_NAME, _names(details))
        _take_accounts(connection, book, _BY_ID, _ids_of_first_use(details, commands, book))
    for part in _parts(mark for command in commands for mark in _fingerprint_of(command)):
        book.fingerprints |= set(connection.execute(_FINGERPRINTS, {"names": part}).scalars())
    return book


def parked_entries(connection: Connection, works: Sequence[Work], parked: Container[int]) -> dict[str, int]:
    """Return the entries that a batch would change and that stand in one of these events, by id; no event is read."""
    commands = [work.command for work in works if isinstance(work, Order)]
    found: dict[str, int] = {}
    for part in _parts(name for command in commands for name in _entry_of(command)):
        found.update((row.id, row.seq) for row in connection.execute(_PLACES, {"names": part}))
    return {name: seq for name, seq in found.items() if seq in parked}


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
    )


def _take_accounts(connection: Connection, book: Book, query: Any, names: Iterable[str]) -> None:
    for part in _parts(names):
        for row in connection.execute(query, {"names": part}):
            book.put(account_of(row))


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
    distinct = list(dict.fromkeys(names))
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
