"""The log on trial: everything that is made of its events again is made once, in a process that may die of it.

Events are taken through the same gate as at a start, decoded and folded; after each slice the process says how far it is,
so a long log is not taken for a hang, and a death leaves a slice in which to look. In that slice halves are tried, first
halves first, until one event is left that kills a process which rebuilds nothing else. Where neither half kills alone there
is no such event, and none is named. Not chosen: to say each event before it is taken; a killer that only spoils memory would
have its neighbour named.
"""

import re
import socket
from collections.abc import Callable
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import Final

import msgspec
from sqlalchemy import Connection, Table, or_, select

from core.journal import queries, schema
from core.journal.as_it_stands import open_as_it_stands
from core.journal.store import LEDGER_FILE, snapshot
from core.ledger.events import decode
from core.ledger.evolving import evolve
from core.rulings import Rulings
from core.trying.forking import say

SLICE_EVENTS: Final = 500
READ_MS_MAX: Final = 60_000  # of a copy that nobody writes to

_ID: Final = re.compile(rb'"id":"([^"\\]{1,256})"')


class Span(msgspec.Struct, frozen=True):
    """The events behind `after` up to `until`."""

    after: int
    until: int


class Named(msgspec.Struct, frozen=True):
    """What is known of an event from what its commit wrote beside it, without making anything of it."""

    kind: str = ""
    transaction_id: str = ""
    account_ids: tuple[str, ...] = ()


def killer_in(span: Span, kills: Callable[[Span], bool]) -> int | None:
    """Return the one event that kills by itself, of a span that kills; None where no single one does."""
    while span.until - span.after > 1:
        middle = (span.after + span.until) // 2
        first, second = Span(span.after, middle), Span(middle, span.until)
        if kills(first):
            span = first
        elif kills(second):
            span = second
        else:
            return None
    return span.until


def rebuild(folder: Path, rulings_file: Path, span: Span, words: socket.socket) -> None:
    """Rebuild a span of the copy in a folder, saying how far that is. Blocks; for a process of its own."""
    rulings = Rulings.beside(rulings_file)
    rulings.read()
    gate = rulings.rebuilding
    engine = open_as_it_stands(folder / LEDGER_FILE, 1, READ_MS_MAX)
    with snapshot(engine, READ_MS_MAX) as connection:
        book = {account.id: account for account in queries.all_accounts(connection)}
    at = span.after
    while at < span.until:
        with snapshot(engine, READ_MS_MAX) as connection:
            rows = list(queries.event_rows(connection, at, min(SLICE_EVENTS, span.until - at)))
        for row in rows:
            event = decode(row.body) if gate.takes(row.seq) else None
            if event is not None:
                with suppress(KeyError):  # of a book that is not whole, which a proof will say better
                    book.update(evolve(book, event))
        if not rows:
            break
        at = rows[-1].seq
        say(words, rebuilt=at)
    say(words, over=at)


def named(folder: Path, seq: int) -> Named:
    """Return what the copy's other tables say of an event. Blocks."""
    engine = open_as_it_stands(folder / LEDGER_FILE, 1, READ_MS_MAX)
    try:
        with snapshot(engine, READ_MS_MAX) as connection:
            kind = connection.execute(select(schema.event.c.kind).where(schema.event.c.seq == seq)).scalar()
            booking = connection.execute(
                select(schema.booking.c.id).where(schema.booking.c.seq == seq)
            ).scalar()
            held = connection.execute(
                select(schema.pending.c.id, schema.pending.c.seq).where(
                    or_(schema.pending.c.seq == seq, schema.pending.c.closed_seq == seq)
                )
            ).first()
            lines = [_accounts(connection, schema.posting, seq)]
            if held is not None:
                lines.append(_accounts(connection, schema.pending_posting, held.seq))
            asserted = select(schema.assertion.c.account_id).where(schema.assertion.c.seq == seq)
            lines.append(list(connection.execute(asserted).scalars()))
            found = tuple(dict.fromkeys(chain(*lines))) or _account(connection, seq)
            booking = booking or (held.id if held is not None else "")
            return Named(str(kind or ""), str(booking or ""), found)
    finally:
        engine.dispose()


def _accounts(connection: Connection, lines: Table, seq: int) -> list[str]:
    query = select(lines.c.account_id).where(lines.c.seq == seq).order_by(lines.c.line)
    return list(connection.execute(query).scalars())


def _account(connection: Connection, seq: int) -> tuple[str, ...]:
    """Return the account that an event which books nothing has opened or closed, if one of that name is listed."""
    body = connection.execute(select(schema.event.c.body).where(schema.event.c.seq == seq)).scalar()
    found = _ID.search(body or b"")  # nothing is decoded: this process must live
    account_id = "" if found is None else found[1].decode("utf-8", "replace")
    return () if queries.get_account(connection, account_id) is None else (account_id,)
