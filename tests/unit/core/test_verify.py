from pathlib import Path

import pytest

from core.journal import verify as proof_b
from core.journal.store import LEDGER_FILE, open_reading
from core.journal.verify import GivenUp, Verdict, verify
from tests.unit.core.books import moving, opening, order, pen, tamper

BOOKED = 12


def whole_book(path: Path) -> None:
    with pen(path) as made:
        made.carry_out(opening("a"), opening("b"))
        made.write(*[order(moving(n, "a", "b"), f"k{n}") for n in range(1, BOOKED - 1)])


def verdict(path: Path) -> Verdict:
    readers = open_reading(path / LEDGER_FILE, 1, 1_000)
    try:
        found = verify(readers, 5_000, lambda: False)
    finally:
        readers.dispose()
    assert isinstance(found, Verdict), found
    return found


@pytest.mark.parametrize("slice_events", [1, 5, 6, 12, 1_000])
def test_a_whole_book_is_proven_in_slices_of_any_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, slice_events: int
) -> None:
    monkeypatch.setattr(proof_b, "SLICE_EVENTS", slice_events)
    whole_book(tmp_path)
    found = verdict(tmp_path)
    assert found.ok, found.reason
    assert (found.events, found.trial_balance, found.first_bad_seq) == (BOOKED, {"KRW": "0"}, None)


def test_an_empty_book_is_whole(tmp_path: Path) -> None:
    pen(tmp_path).__enter__().close()
    assert verdict(tmp_path).ok


@pytest.mark.parametrize(
    ("statement", "first_bad_seq"),
    [
        ("UPDATE event SET body = CAST(replace(CAST(body AS TEXT), '4', '5') AS BLOB) WHERE seq = 6", 6),
        ("DELETE FROM event WHERE seq = 7", 7),
        ("DELETE FROM event WHERE seq = 12", 12),
        ("UPDATE event SET hash = zeroblob(32) WHERE seq = 3", 3),
        ("UPDATE event SET key = 'other' WHERE seq = 5", 5),
        ("DELETE FROM idempotency WHERE seq = 5", 5),
        ("INSERT INTO idempotency VALUES ('x', x'00', 99, 201, x'00', x'00')", 99),
        ("UPDATE posting SET amount = amount + 1 WHERE seq = 8 AND line = 0", 8),
        ("DELETE FROM posting WHERE seq = 8", 8),
        ("INSERT INTO posting VALUES (99, 0, 'a', 5, '2026-11-21', 1)", 99),
        ("UPDATE booking SET description = 'gift' WHERE seq = 9", 9),
        ("UPDATE account SET posted = posted + 1 WHERE id = 'a'", None),
        ("INSERT INTO account VALUES ('c', 'C', 'asset', 'KRW', 0, 0, 0)", None),
        ("UPDATE meta SET head_hash = zeroblob(32)", 12),
        ("UPDATE meta SET head_seq = 11", 12),
    ],
)
def test_every_way_to_falsify_a_book_is_found_where_it_is(
    tmp_path: Path, statement: str, first_bad_seq: int | None
) -> None:
    whole_book(tmp_path)
    tamper(tmp_path, statement)
    found = verdict(tmp_path)
    assert not found.ok
    assert found.reason
    assert found.first_bad_seq == first_bad_seq


def test_readers_cannot_write(tmp_path: Path) -> None:
    whole_book(tmp_path)
    readers = open_reading(tmp_path / LEDGER_FILE, 1, 1_000)
    with readers.connect() as connection, pytest.raises(Exception, match="readonly"):
        connection.exec_driver_sql("UPDATE account SET posted = 0")
    readers.dispose()


def test_a_proof_is_given_up_when_the_core_leaves(tmp_path: Path) -> None:
    whole_book(tmp_path)
    readers = open_reading(tmp_path / LEDGER_FILE, 1, 1_000)
    assert isinstance(verify(readers, 5_000, lambda: True), GivenUp)
    readers.dispose()
