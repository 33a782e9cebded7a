"""The one gate of every event that is rebuilt: all proofs go through it, and what is parked is hashed all the same."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from core.guarded.poison import Armoury
from core.guarded.quarantine import Parked, Quarantine, Rules
from core.journal import queries
from core.journal.ahead import Ahead
from core.journal.proof import Proven, Tail, prove
from core.journal.rebuilding import Rebuilding
from core.journal.store import LEDGER_FILE, open_reading
from core.journal.verify import Verdict, verify
from tests.unit.core.books import Pen, moving, opening, pen

EVENTS = 6


class Watched(Armoury):
    """An armoury that only notes which events were rebuilt."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[int] = []

    def rebuild(self, seq: int) -> None:
        self.seen.append(seq)


@pytest.fixture
def book(tmp_path: Path) -> Iterator[Pen]:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"), opening("b"), *[moving(n, "a", "b") for n in range(1, EVENTS - 1)])
        yield made


def parking(*events: int) -> Quarantine:
    made = Quarantine()
    made.rules = Rules(parked={seq: Parked("L", ("a",)) for seq in events})
    return made


def test_a_spare_that_walks_ahead_goes_through_the_gate_and_hashes_everything(book: Pen) -> None:
    armoury = Watched()
    ahead = Ahead(100, Rebuilding(parking(4), armoury))
    assert ahead.follow(book.connection)
    assert armoury.seen == [1, 2, 3, 5, 6]
    book.connection.exec_driver_sql("BEGIN").close()
    tail = ahead.tail(book.connection, ())
    assert isinstance(tail, Tail), tail
    proof = prove(tail, ())
    assert isinstance(proof, Proven), proof
    assert (proof.tail, proof.head_seq) == (EVENTS, EVENTS)
    book.connection.exec_driver_sql("ROLLBACK").close()


@pytest.mark.usefixtures("book")
def test_the_replay_of_the_whole_book_goes_through_the_gate(tmp_path: Path) -> None:
    armoury = Watched()
    readers = open_reading(tmp_path / LEDGER_FILE, 1, 1_000)
    found = verify(readers, 5_000, lambda: False, Rebuilding(parking(2, 4), armoury))
    readers.dispose()
    assert isinstance(found, Verdict)
    assert (found.ok, found.parked, armoury.seen) == (True, (2, 4), [1, 3, 5, 6])


def test_without_a_guard_every_event_is_taken(book: Pen) -> None:
    rows = list(queries.event_rows(book.connection, 0))
    gate = Rebuilding()
    assert list(gate.over(rows)) == rows
    assert all(gate.takes(row.seq) for row in rows)
    assert gate.accounts_of(1) == ()
