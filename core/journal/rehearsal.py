"""The writing side, once through on a book in memory: fence, proof and bookings, so that each statement is in words.

Putting a statement into words costs some tenths of a millisecond, and from a fence to the answer of a booking there
are some thirty of them. They are kept by the engine that has met them, so a core that waits to be promoted lets the
engine that will write meet them on another book, which is gone afterwards. The household's own is not touched, nor is
its disk looked at: a full one takes no spare from anybody. Not chosen: the same statements against the real file, which may not even be locked by somebody who only waits.
"""

import time
from typing import Final

from sqlalchemy import Connection

from core.guarded.recorder import NoRecorder
from core.journal.ahead import Ahead
from core.journal.answers import Done, LookUp, Order, Work
from core.journal.append import Committed, Journal
from core.journal.chain import Broken
from core.journal.fence import Raised, fence
from core.journal.proof import prove
from core.journal.room import Room
from core.journal.store import Writing
from core.ledger.accounts import AccountType
from core.ledger.commands import (
    Command,
    OpenAccount,
    Posting,
    PostTransaction,
    accounts_of,
    fingerprint_of,
    transaction_of,
)
from core.ledger.entries import EntryBody, RecordEntry, record_entry, reverse_entry

CURRENCY: Final = "KRW"
TAIL_EVENTS: Final = 100


def rehearse_writing(engine: Writing) -> None:
    """Go through all that a core does from its fence to its first bookings. Blocks."""
    recorder = NoRecorder()
    with engine.tried() as connection:
        if connection is None:
            return
        epoch = _raised(connection)
        journal = Journal(connection, epoch, 0, recorder, Room(None, time.monotonic_ns), time.time_ns)
        for works in _batches(recorder):
            done = journal.write(works)
            assert isinstance(done, Committed), done
            assert all(isinstance(answer, Done) for answer in done.answers), done
        _raised(connection)
        _prove(connection)
    recorder.close()


def _raised(connection: Connection) -> int:
    outcome = fence(connection, None, lambda *_: None)
    assert isinstance(outcome, Raised), outcome
    return outcome.epoch


def _prove(connection: Connection) -> None:
    connection.exec_driver_sql("BEGIN").close()
    tail = Ahead(TAIL_EVENTS).tail(connection, ())
    assert not isinstance(tail, Broken), tail
    proof = prove(tail, ())
    assert not isinstance(proof, Broken), proof
    connection.exec_driver_sql("ROLLBACK").close()


def _batches(recorder: NoRecorder) -> list[list[Work]]:
    entry = record_entry(EntryBody(date="2026-01-01", amount="-1", account="a", category="c"), "entry")
    assert isinstance(entry, RecordEntry), entry
    lines = (Posting("a", 1, CURRENCY), Posting("b", -1, CURRENCY))
    return [
        [_order(recorder, OpenAccount(name, name, AccountType.ASSET, CURRENCY, False)) for name in "ab"],
        [
            _order(recorder, PostTransaction("transaction", "2026-01-01", "", (), lines)),
            _order(recorder, entry),
        ],
        [_order(recorder, reverse_entry("entry", "back", None)), LookUp("key-0", _slot(recorder), None)],
    ]


def _order(recorder: NoRecorder, command: Command) -> Order:
    name, digest, slot = transaction_of(command), fingerprint_of(command), _slot(recorder)
    return Order(command, f"key-{slot}", digest, digest, name, name, accounts_of(command), slot)


def _slot(recorder: NoRecorder) -> int:
    slot = recorder.begin("", None, "rehearsal", "", (), b"", 0)
    assert slot is not None, "a page that nobody else uses has slots"
    return slot
