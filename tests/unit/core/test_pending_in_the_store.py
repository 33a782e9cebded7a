"""Pending transactions, bare reversals, batches and assertions on a real file: rows, answers and proofs."""

import datetime as dt
from pathlib import Path
from typing import Any

import msgspec
import pytest
from sqlalchemy.exc import DBAPIError

from core.errands import expiries
from core.guarded.quarantine import Parked, Quarantine, Rules
from core.journal import attestation, queries
from core.journal.answers import Answer, Done, Each, Orders, Refused, SetAside
from core.journal.rebuilding import Rebuilding
from core.journal.register import HouseholdFilter, list_register, summary_of
from core.journal.store import LEDGER_FILE, open_reading
from core.journal.verify import Verdict, verify
from core.ledger.commands import (
    AssertBalance,
    AtomicBatch,
    ExpirePending,
    PostPending,
    PostTransaction,
    ReverseTransaction,
    VoidPending,
)
from core.ledger.reasons import Slug
from core.trying.log import named
from tests.unit.core.books import Pen, closing, moving, opening, order, pen, tamper


def told(answer: Answer) -> Any:
    assert isinstance(answer, Done), answer
    return msgspec.json.decode(answer.body)


def slug(answer: Answer) -> Slug:
    assert isinstance(answer, Refused), answer
    return answer.rejection.slug


def waiting(amount: int, timeout_s: int | None = None) -> PostTransaction:
    return msgspec.structs.replace(moving(amount, "food", "bank"), pending=True, timeout_s=timeout_s)


def proven(path: Path) -> Verdict:
    readers = open_reading(path / LEDGER_FILE, 1, 1_000)
    found = verify(readers, 5_000, lambda: False)
    readers.dispose()
    assert isinstance(found, Verdict)
    return found


def lived(made: Pen) -> list[PostTransaction]:
    """A book with every kind of event in it: 3 to 6 wait, of which 7 to 9 end three and one stays; 10 to 13 the rest."""
    held = [waiting(10, 1), waiting(20), waiting(30), waiting(40)]
    made.carry_out(opening("bank", no_overdraft=True), opening("food"), moving(1_000, "bank", "food"))
    made.carry_out(*held)
    made.journal._wall_ns = lambda: 1_795_000_001_000_000_000
    booked = moving(5, "food", "bank")
    answers = made.carry_out(
        ExpirePending(held[0].id),
        VoidPending(held[1].id),
        PostPending("posted", held[2].id),
        booked,
        ReverseTransaction(booked.id, "back"),
        AssertBalance("said", "bank", "2026-11-21", "970"),
        AssertBalance("said-too", "bank", "2026-11-20", "1"),
    )
    assert all(isinstance(answer, Done) for answer in answers), answers
    return held


def test_a_book_with_every_kind_of_event_is_whole_and_tells_each_life(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        attestation, "EVENTS_BETWEEN", 2
    )  # so that each batch is held against what was attested
    with pen(tmp_path) as made:
        held = lived(made)
        states = [queries.get_transaction(made.connection, one.id, ()) for one in held]
        assert [state and state.state for state in states] == [
            "expired",
            "voided",
            "pending-posted",
            "pending",
        ]
        assert states[2] is not None
        assert states[2].posted_by == "posted"
        posted = queries.get_transaction(made.connection, "posted", ())
        assert posted is not None
        assert (posted.state, posted.pending) == ("posted", held[2].id)
        assert [one.id for one in queries.list_pendings(made.connection, ())] == [held[3].id]
        said = queries.list_assertions(made.connection, ())
        assert [(one.id, one.actual, one.off_by, one.holds) for one in said] == [
            ("said-too", "0", "1", False),
            ("said", "970", "0", True),
        ]
        bank = queries.get_account(made.connection, "bank")
        assert bank is not None
        assert (bank.posted, bank.pending_debit, bank.pending_credit) == (970, 0, 40)
    found = proven(tmp_path)
    assert found.ok, found.reason
    assert found.attested > 0


def test_a_reversed_transaction_and_its_reversal_name_each_other_and_stand_no_longer(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        booked = moving(5, "food", "bank")
        made.carry_out(opening("bank"), opening("food"), booked)
        answer = told(made.carry_out(ReverseTransaction(booked.id, "back"))[0])
        assert (answer["id"], answer["reverses"], answer["entry"]) == ("back", booked.id, None)
        shown = queries.get_transaction(made.connection, booked.id, ())
        assert shown is not None
        assert shown.reversed_by == "back"
        assert list_register(made.connection, HouseholdFilter(account="bank"), ()) == []
        assert slug(made.carry_out(ReverseTransaction(booked.id, "again"))[0]) is Slug.TRANSACTION_REVERSED
        assert slug(made.carry_out(ReverseTransaction("back", "again"))[0]) is Slug.ALREADY_A_REVERSAL


def test_what_is_pending_is_in_no_register_and_no_sum(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("bank"), opening("food"), waiting(5))
        assert list_register(made.connection, HouseholdFilter(account="bank"), ()) == []
        month = summary_of(made.connection, "2026-11", "2026-11-01", "2026-11-30")
        assert [one.amount for one in month.net_worth] == ["0"]


def test_what_falls_due_is_found_when_it_does_and_is_done_once(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        held = [waiting(1, 20), waiting(1, 10), waiting(1)]
        made.carry_out(opening("bank"), opening("food"), *held)
        due_ns = 1_795_000_010_000_000_000
        assert queries.due_pendings(made.connection, due_ns - 1, 10) == []
        assert queries.due_pendings(made.connection, due_ns, 10) == [held[1].id]
        seen = dt.datetime.fromtimestamp(due_ns // 1_000_000_000, dt.UTC)
        (errand,) = expiries(made.connection, seen, 10)
        assert errand.command == ExpirePending(held[1].id)
        assert slug(made.write(order(errand.command, errand.key))[0]) is Slug.NOT_YET_EXPIRED
        # The clock was put back in between; the same key does it when its time has come, and once.
        made.journal._wall_ns = lambda: due_ns
        assert told(made.write(order(errand.command, errand.key))[0])["state"] == "expired"
        (again,) = made.write(order(errand.command, errand.key))
        assert isinstance(again, Done)
        assert again.replayed
        assert expiries(made.connection, seen, 10) == []


def test_a_batch_is_answered_whole_under_its_one_key_and_told_again(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("bank"), opening("food"))
        command = AtomicBatch((moving(1, "food", "bank"), waiting(2)))
        first, again = made.write(order(command, "k"), order(command, "k"))
        answer = told(first)
        assert [item["state"] for item in answer["items"]] == ["posted", "pending"]
        assert (answer["seq"], answer["hash"]) == (4, answer["items"][1]["hash"])
        assert isinstance(first, Done)
        assert again == msgspec.structs.replace(first, replayed=True, commit=None)
        refused = AtomicBatch((moving(1, "food", "bank"), moving(1, "nowhere", "bank")))
        assert slug(made.write(order(refused, "no"))[0]) is Slug.UNKNOWN_ACCOUNT
        assert made.journal.head_seq == 4
    assert proven(tmp_path).ok


def test_commands_sent_together_have_each_its_key_and_its_answer(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("bank", no_overdraft=True), opening("food"))
        orders = (order(moving(1, "bank", "food"), "a"), order(moving(2, "food", "bank"), "b"))
        (answer,) = made.write(Orders((*orders, order(closing("gone"), "c")), 0))
        assert isinstance(answer, Each)
        done, overdrawn, unknown = answer.answers
        assert isinstance(done, Done)
        assert (slug(overdrawn), slug(unknown)) == (Slug.OVERDRAFT, Slug.UNKNOWN_ACCOUNT)
        (told_again,) = made.write(Orders(orders, 0))
        assert isinstance(told_again, Each)
        assert all(one.replayed for one in told_again.answers if isinstance(one, Done | Refused))
        assert slug(made.look_up("b")) is Slug.OVERDRAFT


def test_an_assertion_sees_what_was_booked_before_it_in_its_own_batch(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        answers = made.carry_out(
            opening("bank"),
            opening("food"),
            moving(7, "bank", "food"),
            AssertBalance("said", "bank", "2026-11-21", "7"),
            moving(1, "bank", "food"),
        )
        assert told(answers[3])["holds"] is True
    assert proven(tmp_path).ok


@pytest.mark.parametrize(
    ("statement", "first_bad_seq"),
    [
        ("UPDATE pending SET expires_ns = 1 WHERE seq = 4", 4),
        ("UPDATE pending SET description = 'gift' WHERE seq = 5", 5),
        ("UPDATE pending SET date = '2026-01-01' WHERE seq = 5", 5),
        ("UPDATE pending SET state = 'open', closed_seq = NULL WHERE closed_seq = 9", 9),
        ("UPDATE pending SET state = 'voided' WHERE closed_seq = 8", 8),
        ("UPDATE pending SET state = 'voided', closed_seq = 3 WHERE seq = 7", 3),
        ("UPDATE pending SET state = 'voided', closed_seq = 99 WHERE seq = 7", 99),
        ("DELETE FROM pending WHERE seq = 7", 7),
        ("UPDATE pending_posting SET amount = amount * 2 WHERE seq = 7", 7),
        ("UPDATE pending_posting SET account_id = 'food' WHERE seq = 6 AND line = 1", 6),
        ("DELETE FROM pending_posting WHERE seq = 5", 5),
        ("INSERT INTO pending_posting VALUES (2, 0, 'bank', 5)", 2),
        ("UPDATE assertion SET amount = 1, holds = 0 WHERE id = 'said'", 13),
        ("UPDATE assertion SET date = '2026-11-22' WHERE id = 'said'", 13),
        ("DELETE FROM assertion WHERE id = 'said-too'", 14),
        ("INSERT INTO assertion VALUES ('new', 99, 'bank', '2026-11-21', 1, 1, 1)", 99),
        ("DELETE FROM reversal", 11),
        ("UPDATE account SET pending_credit = 39 WHERE id = 'bank'", None),
        ("UPDATE account SET pending_debit = 0 WHERE id = 'food'", None),
        ("UPDATE account SET version = version + 1 WHERE id = 'bank'", None),
    ],
)
def test_every_way_to_falsify_what_is_pending_or_was_said_is_found(
    tmp_path: Path, statement: str, first_bad_seq: int | None
) -> None:
    with pen(tmp_path) as made:
        lived(made)
    tamper(tmp_path, statement)
    found = proven(tmp_path)
    assert not found.ok
    assert found.first_bad_seq == first_bad_seq, found.reason


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE pending SET state = 'open', closed_seq = NULL WHERE closed_seq = 8",
        "UPDATE pending SET state = 'posted' WHERE closed_seq = 8",
        "UPDATE pending SET expires_ns = 1 WHERE seq = 7",
        "DELETE FROM pending WHERE seq = 7",
        "UPDATE pending_posting SET amount = 0",
        "DELETE FROM pending_posting",
        "UPDATE assertion SET date = ''",
        "DELETE FROM assertion",
        "UPDATE account SET pending_credit = 971 WHERE id = 'bank'",
        "UPDATE account SET pending_debit = -1 WHERE id = 'food'",
    ],
)
def test_the_tables_keep_what_is_pending_from_whoever_writes(tmp_path: Path, statement: str) -> None:
    with pen(tmp_path) as made:
        lived(made)
        with pytest.raises(DBAPIError, match=r"never|once|CHECK"):
            made.connection.exec_driver_sql(statement).close()


def spoil(made: Pen, *seqs: int) -> None:
    """Have whoever reads these events fail, as if their bytes killed him."""
    made.connection.exec_driver_sql("DROP TRIGGER event_is_never_changed").close()
    for seq in seqs:
        made.connection.exec_driver_sql(f"UPDATE event SET body = x'00' WHERE seq = {seq}").close()


def test_what_is_pending_is_drawn_from_the_tables_where_its_events_are_left_out(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        held = lived(made)
        before = [queries.get_transaction(made.connection, name, ()) for name in ("posted", held[3].id)]
        seqs = [one.seq for one in before if one is not None]
        spoil(made, *seqs)
        for was in before:
            assert was is not None
            drawn = queries.get_transaction(made.connection, was.id, seqs)
            assert drawn == msgspec.structs.replace(was, state="set-aside", tags=())


@pytest.mark.parametrize("seq", range(4, 15))
def test_the_book_is_proven_around_any_of_its_events_that_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seq: int
) -> None:
    monkeypatch.setattr(attestation, "EVENTS_BETWEEN", 2)
    with pen(tmp_path) as made:
        lived(made)
    quarantine = Quarantine()
    quarantine.rules = Rules(parked={seq: Parked("L", ())})
    readers = open_reading(tmp_path / LEDGER_FILE, 1, 1_000)
    found = verify(readers, 5_000, lambda: False, Rebuilding(quarantine))
    readers.dispose()
    assert isinstance(found, Verdict)
    assert found.ok, found.reason
    assert found.parked == (seq,)


def test_a_command_that_would_begin_with_an_event_that_is_left_out_is_set_aside_unread(
    tmp_path: Path,
) -> None:
    with pen(tmp_path) as made:
        held = lived(made)
        spoil(made, 3, 7)
        made.journal._quarantine.rules = Rules(parked={3: Parked("L", ()), 7: Parked("M", ())})
        booked = queries.list_transactions(made.connection, queries.TransactionFilter(), (3,))[-1].id
        answers = made.carry_out(
            VoidPending(held[3].id), ReverseTransaction(held[3].id, "x"), ReverseTransaction(booked, "y")
        )
        assert answers == (SetAside("M"), SetAside("M"), SetAside("L"))


def test_the_names_of_an_event_that_ends_or_asserts_are_known_without_reading_it(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        held = lived(made)
    found = named(tmp_path, 9)
    assert (found.kind, found.transaction_id, found.account_ids) == (
        "pending.voided",
        held[1].id,
        ("food", "bank"),
    )
    assert named(tmp_path, 13).account_ids == ("bank",)
