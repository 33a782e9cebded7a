import json
from pathlib import Path

import pytest

from core.guarded.quarantine import Quarantine
from core.journal import verify as proof_b
from core.journal.rebuilding import Rebuilding
from core.journal.store import LEDGER_FILE, open_reading
from core.journal.verify import GivenUp, Verdict, verify
from tests.unit.core.books import closing, entering, moving, opening, order, pen, replacing, tamper

BOOKED = 12


def whole_book(path: Path) -> None:
    with pen(path) as made:
        made.carry_out(opening("a"), opening("b"))
        made.write(*[order(moving(n, "a", "b"), f"k{n}") for n in range(1, BOOKED - 1)])


def verdict(path: Path, rebuilding: Rebuilding | None = None) -> Verdict:
    readers = open_reading(path / LEDGER_FILE, 1, 1_000)
    try:
        found = verify(readers, 5_000, lambda: False, rebuilding)
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
        ("INSERT INTO account VALUES ('c', 'C', 'asset', 'KRW', 0, 0, 0, 0, 0, 1)", None),
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


def parking(path: Path, *events: int, accounts: tuple[str, ...] = ("a", "b")) -> Rebuilding:
    file = path / "quarantine.json"
    rules = [{"id": "letter", "type": "parked", "seq": seq, "account_ids": accounts} for seq in events]
    file.write_text(json.dumps({"version": 1, "serial": 1, "rules": rules}))
    quarantine = Quarantine(file)
    assert quarantine.read() is None
    return Rebuilding(quarantine)


def test_an_event_that_is_parked_is_left_out_of_the_proof_and_named(tmp_path: Path) -> None:
    whole_book(tmp_path)
    found = verdict(tmp_path, parking(tmp_path, 6, 9))
    assert found.ok, found.reason
    assert (found.events, found.parked, found.trial_balance) == (BOOKED, (6, 9), {"KRW": "0"})


def test_a_parked_event_is_never_read_and_still_hashed(tmp_path: Path) -> None:
    whole_book(tmp_path)
    tamper(tmp_path, "UPDATE event SET body = x'00' WHERE seq = 6")
    unread = verdict(tmp_path, parking(tmp_path, 6))
    assert (unread.first_bad_seq, unread.ok) == (6, False), "its hash counts as ever"
    assert unread.reason is not None
    assert "can't be read" not in unread.reason


def test_all_other_accounts_are_held_against_the_events_that_are_left(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(*[opening(name) for name in "abcd"])
        made.write(order(moving(5, "a", "b")), order(moving(7, "c", "d")), order(moving(1, "a", "c")))
    rebuilding = parking(tmp_path, 5)
    assert verdict(tmp_path, rebuilding).ok
    tamper(tmp_path, "UPDATE account SET posted = posted + 1 WHERE id = 'c'")
    assert not verdict(tmp_path, rebuilding).ok


@pytest.mark.parametrize("accounts", [("c",), ()])
def test_an_account_may_have_been_opened_by_what_is_parked(tmp_path: Path, accounts: tuple[str, ...]) -> None:
    with pen(tmp_path) as made:
        made.carry_out(*[opening(name) for name in "abc"])
        assert verdict(tmp_path, parking(tmp_path, 3, accounts=accounts)).ok
        made.write(order(moving(7, "a", "c")))
    assert verdict(tmp_path, parking(tmp_path, 3, accounts=accounts)).ok


@pytest.mark.parametrize("accounts", [("c",), ()])
@pytest.mark.parametrize("seq", [3, 4])
def test_an_account_may_be_closed_whose_opening_is_parked_or_opened_whose_end_is(
    tmp_path: Path, seq: int, accounts: tuple[str, ...]
) -> None:
    with pen(tmp_path) as made:
        made.carry_out(*[opening(name) for name in "abc"])
        made.carry_out(closing("c"))
    found = verdict(tmp_path, parking(tmp_path, seq, accounts=accounts))
    assert found.ok, found.reason


def test_entries_are_counted_whether_or_not_their_events_are_read(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("bank"))
        entry = entering("-5", category="food")
        made.write(order(entry))
        made.write(order(replacing(entry.id, "-7", category="food")))
        head = made.journal.head_seq
    for seq in range(2, head + 1):
        found = verdict(tmp_path, parking(tmp_path, seq, accounts=()))
        assert found.ok, (seq, found.reason)
