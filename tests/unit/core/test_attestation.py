"""Attestations and the proofs that go by them: on real stores, with a few events between two."""

from pathlib import Path
from typing import Any

import msgspec
import pytest
from sqlalchemy import Connection
from sqlalchemy.exc import IntegrityError

from core.journal import ahead as ahead_room
from core.journal import attestation, queries
from core.journal.ahead import Ahead
from core.journal.answers import Done, KeyUnknown, LookUp, ReadOnly
from core.journal.append import NotTaken
from core.journal.attestation import NOTHING, attest, due_between, is_due, standing
from core.journal.chain import Broken
from core.journal.proof import ProofKind, Proven, Walk, Witness, prove
from core.journal.store import StoreFault
from core.ledger.accounts import AccountType
from tests.unit.core.books import Pen, entering, moving, opened, opening, order, pen, replacing, tamper
from tests.unit.core.test_verify import verdict

BETWEEN = 10
ALL = 1_000


@pytest.fixture(autouse=True)
def _few_between(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(attestation, "EVENTS_BETWEEN", BETWEEN)
    monkeypatch.setattr(ahead_room, "SLICE_EVENTS", 4)


def accounts(made: Pen) -> None:
    made.carry_out(opening("bank"), opening("food", AccountType.EXPENSE))


def book(made: Pen, count: int) -> None:
    """Book so many events, some of them in batches of three."""
    while count:
        together = min(count, 3)
        made.carry_out(*[moving(7, "food", "bank") for _ in range(together)])
        count -= together


def attested(made: Pen) -> list[int]:
    return sorted(queries.attestations_between(made.connection, 1, 1 << 40))


def proof(connection: Connection, walked: Ahead | None = None, *witnesses: Witness) -> Proven | Broken:
    tail = (walked or Ahead(ALL)).tail(connection, witnesses)
    return tail if isinstance(tail, Broken) else prove(tail, witnesses)


def proof_of_file(path: Path) -> Proven | Broken:
    connection = opened(path)
    try:
        return proof(connection)
    finally:
        connection.close()
        connection.engine.dispose()


def seen(made: Pen, seq: int) -> Witness:
    row = queries.event_row(made.connection, seq)
    assert row is not None
    return Witness(row.seq, row.epoch, row.hash)


def follow_to_the_head(walked: Ahead, connection: Connection) -> None:
    while not walked.follow(connection):
        assert walked.fault is None


def test_it_falls_due_after_every_so_many_events_and_nowhere_else() -> None:
    assert [seq for seq in range(25) if is_due(seq)] == [10, 20]
    assert list(due_between(0, 9)) == []
    assert list(due_between(9, 10)) == [10]
    assert list(due_between(10, 11)) == []
    assert list(due_between(8, 31)) == [10, 20, 30]


def test_accounts_at_zero_and_their_order_make_no_difference() -> None:
    few = standing([("b", "KRW", -5), ("a", "KRW", 5)], {})
    more = standing([("a", "KRW", 7), ("c", "USD", 0), ("b", "KRW", -5), ("d", "KRW", 2)], {"a": 2, "d": 2})
    assert attest(1, bytes(32), few) == attest(1, bytes(32), more)
    assert attest(1, bytes(32), few).sums == '{"KRW": ["5", "-5"]}'
    assert attest(1, bytes(32), standing([("a", "USD", 5), ("b", "KRW", -5)], {})) != attest(
        1, bytes(32), few
    )


def test_what_was_posted_to_an_account_that_is_not_there_is_not_passed_over() -> None:
    assert standing([], {"a": 5}) != {}


def test_the_balances_after_exactly_the_due_event_are_attested_wherever_it_falls_in_its_batch(
    tmp_path: Path,
) -> None:
    with pen(tmp_path) as made:
        accounts(made)
        book(made, 6)
        made.carry_out(*[moving(100 * n, "food", "bank") for n in range(1, 6)], opening("late"))
        stored = queries.newest_attestation(made.connection)
        row = queries.event_row(made.connection, 10)
        assert stored is not None
        assert row is not None
        stood = 6 * 7 + 100 + 200
        by_hand = {"bank": ("KRW", -stood), "food": ("KRW", stood)}
        assert stored == attest(10, row.hash, by_hand)
        assert attested(made) == [10]
    assert verdict(tmp_path).ok


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE account SET posted = posted + iif(id = 'food', 1000, -1000)",
        "UPDATE posting SET amount = amount + 1 WHERE seq = 14 AND line = 0",
        "DELETE FROM posting WHERE seq = 14",
        "UPDATE attestation SET balances = zeroblob(32) WHERE seq = 10",
    ],
)
def test_balances_that_do_not_follow_from_the_attestation_before_are_not_attested_and_not_written_on(
    tmp_path: Path, statement: str
) -> None:
    known = order(moving(1, "food", "bank"), "known")
    with pen(tmp_path) as made:
        accounts(made)
        book(made, 15)
        made.write(known)
        tamper(tmp_path, statement)
        book(made, 1)
        before = verdict(tmp_path).reason
        for _ in range(2):
            outcome = made.journal.write(
                [order(moving(7, "food", "bank"), "new"), known, LookUp("known", 0), LookUp("new", 0)]
            )
            assert isinstance(outcome, NotTaken)
            assert outcome.error.fault is StoreFault.DAMAGED
            assert "attested after event 10" in outcome.error.text
            new, again, found, unknown = outcome.answers
            assert new == ReadOnly("STORE_CORRUPT")
            assert isinstance(again, Done)
            assert isinstance(found, Done)
            assert isinstance(unknown, KeyUnknown)
        assert (attested(made), queries.head(made.connection).head_seq) == ([10], 19)
        assert isinstance(proof(made.connection), Broken)
    assert verdict(tmp_path).reason == before


def test_the_first_attestation_is_held_against_the_book_that_began_empty(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        accounts(made)
        book(made, 7)
        tamper(tmp_path, "UPDATE account SET posted = posted + iif(id = 'food', 1000, -1000)")
        assert isinstance(made.journal.write([order(moving(7, "food", "bank"))]), NotTaken)
        assert attested(made) == []


def test_a_long_book_that_was_never_attested_is_attested_as_it_stands(tmp_path: Path) -> None:
    """Nobody has looked at it, and a batch is no time to do so: the replay of the whole book is."""
    with pen(tmp_path) as made:
        accounts(made)
        book(made, 17)
        tamper(tmp_path, "DELETE FROM attestation")
        book(made, 1)
        assert attested(made) == [20]


def test_a_batch_that_passes_two_due_events_attests_both(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        accounts(made)
        made.carry_out(*[moving(n, "food", "bank") for n in range(1, 29)])
        assert attested(made) == [10, 20, 30]
    assert verdict(tmp_path).ok


def test_entries_and_their_reversals_are_attested_as_they_stand(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("bank"))
        for number in range(10):
            command = entering(f"-{number + 5}", category=f"c{number % 3}")
            made.write(order(command), order(replacing(command.id, f"{number + 6}")))
        assert attested(made) == [10, 20, 30]
        assert isinstance(proof(made.connection), Proven)
    assert verdict(tmp_path).ok


def test_an_attestation_is_written_once_for_an_event_that_is_there(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        accounts(made)
        book(made, 10)
        for statement in (
            "UPDATE attestation SET sums = '{}'",
            "DELETE FROM attestation",
            "INSERT INTO attestation SELECT 11, hash, hash, '{}' FROM event WHERE seq = 10",
            "INSERT INTO attestation SELECT 99, hash, hash, '{}' FROM event WHERE seq = 10",
        ):
            with pytest.raises(IntegrityError):
                made.connection.exec_driver_sql(statement)


@pytest.mark.parametrize(
    ("statement", "place"),
    [
        ("UPDATE attestation SET balances = zeroblob(32) WHERE seq = 10", 10),
        ("UPDATE attestation SET hash = zeroblob(32) WHERE seq = 20", 20),
        ("UPDATE attestation SET sums = '{}' WHERE seq = 20", 20),
        ("DELETE FROM attestation WHERE seq = 20", 20),
        ("UPDATE attestation SET seq = 19 WHERE seq = 20", 19),
        ("UPDATE attestation SET seq = 99 WHERE seq = 20", 20),
        ("INSERT INTO attestation SELECT 99, hash, hash, '{}' FROM event WHERE seq = 10", 99),
    ],
)
def test_a_falsified_attestation_is_found_by_the_whole_proof(
    tmp_path: Path, statement: str, place: int
) -> None:
    with pen(tmp_path) as made:
        accounts(made)
        book(made, 23)
    assert (verdict(tmp_path).ok, verdict(tmp_path).attested) == (True, 20)
    tamper(tmp_path, statement)
    found = verdict(tmp_path)
    assert (found.ok, found.first_bad_seq) == (False, place), found.reason


def test_a_tail_begins_after_the_last_attestation_and_a_witness_before_it_is_looked_up_alone(
    tmp_path: Path,
) -> None:
    with pen(tmp_path) as made:
        accounts(made)
        book(made, 22)
        old, new = seen(made, 3), seen(made, 24)
        found = proof(made.connection, None, old, new)
        assert isinstance(found, Proven)
        assert (found.kind, found.tail, found.head_seq) == (ProofKind.WITNESS, 4, 24)
        lied = Witness(3, 1, bytes(32))
        broken = proof(made.connection, None, new, lied)
        assert isinstance(broken, Broken)
        assert broken.seq == 3


def test_a_young_book_is_proven_from_its_first_event(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        accounts(made)
        book(made, 5)
        found = proof(made.connection)
        assert isinstance(found, Proven)
        assert found.tail == 7


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE account SET posted = posted + iif(id = 'food', 3, -3)",
        "UPDATE posting SET amount = amount + 1 WHERE seq = 24 AND line = 0",
        "DELETE FROM posting WHERE seq = 23",
        "UPDATE event SET hash = zeroblob(32) WHERE seq = 20",
        "UPDATE attestation SET balances = zeroblob(32) WHERE seq = 20",
        "DELETE FROM event WHERE seq = 20",
    ],
)
@pytest.mark.parametrize("whole_tail", [False, True])
def test_money_that_moved_without_an_event_is_found_before_serving(
    tmp_path: Path, statement: str, *, whole_tail: bool
) -> None:
    with pen(tmp_path) as made:
        accounts(made)
        book(made, 22)
    assert isinstance(proof_of_file(tmp_path), Proven)
    tamper(tmp_path, statement, *(["DELETE FROM attestation WHERE seq < 20"] if whole_tail else []))
    assert isinstance(proof_of_file(tmp_path), Broken)


def test_a_spare_proves_ahead_and_has_the_few_events_since_left(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        accounts(made)
        walked = Ahead(ALL)
        follow_to_the_head(walked, made.connection)
        for _ in range(3):
            book(made, 8)
            follow_to_the_head(walked, made.connection)
        assert walked.seq == 26
        book(made, 2)
        tail = walked.tail(made.connection, ())
        assert not isinstance(tail, Broken)
        rows = list(tail.rows)
        assert [row.seq for row in rows] == [27, 28]
        assert tail.walk.checked > 2
        found = prove(msgspec.structs.replace(tail, rows=rows), ())
        assert isinstance(found, Proven)
        assert found.tail == tail.walk.checked


def test_a_spare_that_fell_behind_begins_anew_at_the_last_attestation(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        accounts(made)
        walked = Ahead(ALL)
        follow_to_the_head(walked, made.connection)
        book(made, 60)
        assert not walked.follow(made.connection) or walked.seq > 60
        assert walked.seq > 60
        assert isinstance(proof(made.connection, walked), Proven)


def test_a_spare_takes_a_slice_at_a_time(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        accounts(made)
        book(made, 7)
        walked = Ahead(ALL)
        assert [walked.follow(made.connection) for _ in range(3)] == [False, False, True]
        assert walked.seq == 9


def test_a_spare_sees_an_event_that_changed_after_it_has_met_it(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        accounts(made)
        book(made, 5)
        walked = Ahead(ALL)
        follow_to_the_head(walked, made.connection)
    tamper(tmp_path, "UPDATE event SET hash = zeroblob(32) WHERE seq = 7")
    connection = opened(tmp_path)
    found = proof(connection, walked)
    connection.close()
    assert isinstance(found, Broken)
    assert found.seq == 7


def test_a_spare_that_meets_a_broken_chain_says_so_and_its_proof_fails(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        accounts(made)
        book(made, 5)
    tamper(tmp_path, "UPDATE event SET hash = zeroblob(32) WHERE seq = 4")
    connection = opened(tmp_path)
    walked = Ahead(ALL)
    assert walked.follow(connection)
    assert walked.fault is not None
    assert walked.fault.seq == 4
    found = proof(connection, walked)
    connection.close()
    assert isinstance(found, Broken)


def test_what_a_spare_has_seen_broken_stays_broken_whatever_the_writer_attests_since(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        accounts(made)
        book(made, 5)
        walked = Ahead(ALL)
        follow_to_the_head(walked, made.connection)
        book(made, 2)
        tamper(tmp_path, "UPDATE event SET body = zeroblob(9) WHERE seq = 8")
        while not walked.follow(made.connection):
            pass
        assert walked.fault is not None
        seen_broken = walked.fault
        book(made, 10)
        assert attested(made) == [10]
        assert isinstance(proof(made.connection), Proven), "who begins at the attestation has not seen it"
        assert walked.follow(made.connection)
        assert proof(made.connection, walked) == seen_broken


def test_an_older_book_that_was_never_attested_is_proven_over_its_last_events(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        accounts(made)
        book(made, 22)
    tamper(tmp_path, "DELETE FROM attestation")
    with pen(tmp_path) as made:
        walked = Ahead(6)
        tail = walked.tail(made.connection, ())
        assert not isinstance(tail, Broken)
        assert (tail.walk.base, tail.walk.seq) == (None, 18)
        book(made, 5)
        follow_to_the_head(walked, made.connection)
        assert walked.seq == 29
        book(made, 5)
        follow_to_the_head(walked, made.connection)
        book(made, 1)
        follow_to_the_head(walked, made.connection)
        assert isinstance(proof(made.connection, walked), Proven)
        assert attested(made) == [30]


def test_sums_beyond_64_bits_are_added_exactly(tmp_path: Path) -> None:
    most = 9_000_000_000_000_000_000
    with pen(tmp_path) as made:
        made.carry_out(opening("bank"), opening("a", AccountType.EXPENSE), opening("b", AccountType.EXPENSE))
        for _ in range(3):
            made.carry_out(moving(most, "a", "bank"), moving(-most, "a", "bank"))
        assert queries.moved_between(made.connection, 1) == {"a": 0, "bank": 0}
        rows: list[dict[str, Any]] = [{"n": 4}, {"n": 6}, {"n": 8}]
        moved = [queries.moved_between(made.connection, row["n"], row["n"]) for row in rows]
        assert moved == [{"a": most, "bank": -most}] * 3


def test_nothing_is_what_an_empty_book_stands_at() -> None:
    assert attest(0, NOTHING.hash, standing([("a", "KRW", 0)], {})) == NOTHING
    assert Walk(NOTHING, None).seq == 0
