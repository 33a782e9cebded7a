"""The whole log out of a store and into a new one: what leaves with whoever leaves, and what brings them back.

Out: everything up to one event, in slices, while others write. In: every link of the chain is checked as its line is read, the
tables are made anew from the events by the same rooms that wrote them the first time, and the keys are laid beside them, because
they follow from nothing. It is done in a file of its own that becomes a ledger only when all of it was proven. What stands in
the new book is the same history, to the byte; its core raises the epoch as ever. Not chosen: to send each event as a command once
more. It would get a new time and a new hash, and would be another history.
"""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Final

import msgspec
from sqlalchemy import Connection, Engine, insert, select
from sqlalchemy.exc import IntegrityError

from core.journal import queries, schema
from core.journal.answers import KeyRow
from core.journal.batch import Batch
from core.journal.chain import GENESIS, EventRow, check_link
from core.journal.laying import lay_down
from core.journal.log_lines import FORMAT, VERSION, Foot, Head, event_line, key_line, read_head, read_line
from core.journal.store import (
    StoreError,
    WritingEngine,
    begin_writing,
    close_writing,
    commit,
    settle,
    snapshot,
)
from core.ledger.book import Book
from core.ledger.events import decode

SLICE: Final = 1_000
READ_MS_MAX: Final = 30_000
BUSY_MS: Final = 5_000


class Unusable(msgspec.Struct, frozen=True):
    """A log that is not taken: in which line (from 1; 0: nobody can say) and why, as a part of a sentence."""

    line: int
    why: str


def lines_of(readers: Engine, tick: Callable[[int, int], object]) -> Iterator[bytes]:
    """Give the lines of a whole log, of the moment at which this begins. `tick`: events told, of how many.

    Raises DBAPIError where the store can't be read.
    """
    with snapshot(readers, READ_MS_MAX) as connection:
        meta = queries.head(connection)
    head = Head(FORMAT, VERSION, meta.epoch, meta.head_seq, meta.head_hash.hex())
    yield msgspec.json.encode(head) + b"\n"
    seq = keys = 0
    while seq < head.seq:
        with snapshot(readers, READ_MS_MAX) as connection:
            rows = list(queries.event_rows(connection, seq, min(SLICE, head.seq - seq)))
        yield b"".join(map(event_line, rows))
        seq = rows[-1].seq
        tick(seq, head.seq)
    after = ""
    while found := _keys_after(readers, after, head.seq):
        yield b"".join(key_line(key, row) for key, row in found)
        after, keys = found[-1][0], keys + len(found)
    yield msgspec.json.encode({"end": Foot(head.seq, keys)}) + b"\n"


def _keys_after(readers: Engine, after: str, last_seq: int) -> list[tuple[str, KeyRow]]:
    """Return the next keys in their order; what was committed behind the last event of this log is none of it."""
    kept = schema.idempotency.c
    query = select(kept.key, kept.fingerprint, kept.seq, kept.status, kept.reply, kept.digest)
    query = query.where(kept.key > after, (kept.seq.is_(None)) | (kept.seq <= last_seq))
    with snapshot(readers, READ_MS_MAX) as connection:
        rows = connection.execute(query.order_by(kept.key).limit(SLICE)).all()
    return [(row[0], KeyRow(*row[1:])) for row in rows]


def take_in(
    lines: Iterable[bytes], into: Path, tick: Callable[[int, int], object]
) -> Head | Unusable | StoreError:
    """Make a ledger of a log in a new file; return what it holds, or why there is none. The caller removes what is left.

    `tick`: events taken in, of how many.
    """
    read = iter(lines)
    head = read_head(next(read, b""))
    if isinstance(head, str):
        return Unusable(1, head)
    connection = WritingEngine(into, lasting=False).connect(BUSY_MS)
    if isinstance(connection, StoreError):
        return connection
    try:
        begin_writing(connection)
        # The rules come last: they would refuse what was written in an older epoch.
        schema.metadata.create_all(connection, checkfirst=False)
        try:
            broken = _pour(connection, read, head, tick)
        except (
            IntegrityError
        ) as error:  # a second event or key of one name, or a key of an event that is not there
            broken = Unusable(0, f"its lines contradict each other ({error.orig})")
        if broken is not None:
            return broken
        schema.lay_triggers(connection)
        commit(connection)
    finally:
        close_writing(connection)
    return settle(into) or head


def _pour(
    connection: Connection, lines: Iterator[bytes], head: Head, tick: Callable[[int, int], object]
) -> Unusable | None:
    book, last, keys = Book(), None, 0
    batch = _fresh(book)
    number = 1
    for line in lines:
        number += 1
        said = read_line(line)
        if isinstance(said, str):
            return Unusable(number, said)
        if isinstance(said, Foot):
            lay_down(connection, batch)
            return _ended(connection, said, head, last, keys, number)
        if isinstance(said, EventRow):
            wrong = _follow(batch, last, said)
            if wrong is not None:
                return Unusable(number, wrong)
            last = said
        else:
            keys += 1
            batch.key_rows.append({"key": said[0], **msgspec.structs.asdict(said[1])})
        if len(batch.events) + len(batch.key_rows) >= SLICE:
            lay_down(connection, batch)
            batch = _fresh(book)
            tick(last.seq if last else 0, head.seq)
    return Unusable(number, "it ends before its end: the file was cut off")


def _follow(batch: Batch, last: EventRow | None, row: EventRow) -> str | None:
    """Take an event in, or say what is wrong with it."""
    broken = check_link(last, row)
    if broken is not None:
        return broken.sentence
    event = decode(row.body)
    if event is None:
        return f"event {row.seq} is none that this version knows"
    try:
        batch.follow(row, event)
    except (KeyError, AssertionError):
        return f"event {row.seq} speaks of what was never there"
    return None


def _ended(
    connection: Connection, foot: Foot, head: Head, last: EventRow | None, keys: int, number: int
) -> Unusable | None:
    """Write down where the book stands, if all that was promised is there."""
    seq, digest = (last.seq, last.hash) if last is not None else (0, GENESIS)
    if (foot.events, foot.keys) != (seq, keys) or (head.seq, head.head) != (seq, digest.hex()):
        return Unusable(number, "its head and its foot speak of other lines than there are")
    connection.execute(
        insert(schema.meta).values(
            id=1, schema_version=schema.SCHEMA_VERSION, epoch=head.epoch, head_seq=seq, head_hash=digest
        )
    )
    return None


def _fresh(book: Book) -> Batch:
    return Batch(0, 0, GENESIS, book, {})
