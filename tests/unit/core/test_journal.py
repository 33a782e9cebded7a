import sqlite3
from pathlib import Path

import msgspec
import pytest
from sqlalchemy import text
from sqlalchemy.exc import IntegrityError

from core.guarded.recorder import NoRecorder
from core.journal import queries
from core.journal.answers import (
    DecisionFailed,
    Done,
    Exercise,
    KeyTaken,
    KeyUnknown,
    LookUp,
    OutcomeUnknown,
    ReadOnly,
    Refused,
    StoreBusy,
    Touch,
)
from core.journal.append import Failed, FencedBy, Journal, NotBegun, NotTaken
from core.journal.fence import Fenced, NotOurs, Raised, StoreWentBack
from core.journal.room import Room
from core.journal.store import LEDGER_FILE, StoreError, StoreFault, open_writing
from core.ledger.reasons import Slug
from tests.unit.core.books import (
    Pen,
    closing,
    failing_at_commit,
    fenced,
    moving,
    opened,
    opening,
    order,
    pen,
    tamper,
)

FOR_EVER_NS = 2**63 - 1


def accounts(made: Pen) -> dict[str, int]:
    return {account.id: account.posted for account in queries.all_accounts(made.connection)}


def test_a_batch_is_booked_with_numbers_without_gaps(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"), opening("b"), moving(5, "a", "b"), moving(7, "a", "b"))
        assert [row.seq for row in queries.event_rows(made.connection, 0)] == [1, 2, 3, 4]
        assert accounts(made) == {"a": 12, "b": -12}


def test_two_commands_of_one_batch_cannot_spend_the_same_money(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a", no_overdraft=True), opening("b"), moving(10, "a", "b"))
        first, second = made.carry_out(moving(10, "b", "a"), moving(10, "b", "a"))
        assert isinstance(first, Done)
        assert isinstance(second, Refused)
        assert accounts(made) == {"a": 0, "b": 0}


def test_a_refused_command_leaves_nothing_behind(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a", no_overdraft=True), opening("b"))
        refused, done = made.carry_out(moving(10, "b", "a"), moving(3, "a", "b"))
        assert isinstance(refused, Refused)
        assert isinstance(done, Done)
        assert accounts(made) == {"a": 3, "b": -3}
        assert queries.head(made.connection).head_seq == 3


def test_an_account_can_be_opened_used_and_closed_in_one_batch(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        answers = made.carry_out(
            opening("a"), opening("b"), moving(1, "a", "b"), closing("a"), moving(1, "a", "b")
        )
        assert [isinstance(answer, Done) for answer in answers] == [True] * 4 + [False]


def test_a_key_is_answered_twice_and_carried_out_once(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"), opening("b"))
        command = moving(5, "a", "b")
        first, again = made.write(order(command, "k"), order(command, "k"))
        later = made.write(order(command, "k"))[0]
        assert isinstance(first, Done)
        assert not first.replayed
        assert again == later == Done(first.status, first.body, replayed=True)
        assert accounts(made) == {"a": 5, "b": -5}


def test_a_key_that_belongs_to_another_wish_is_refused(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"), opening("b"))
        made.write(order(moving(5, "a", "b"), "k"))
        assert made.write(order(moving(6, "a", "b"), "k")) == (KeyTaken(),)


def test_a_refusal_by_the_book_is_kept_under_its_key(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a", no_overdraft=True), opening("b"))
        command = moving(5, "b", "a")
        first = made.write(order(command, "k"))[0]
        made.carry_out(moving(100, "a", "b"))
        again = made.write(order(command, "k"))[0]
        assert isinstance(first, Refused)
        assert first.rejection.slug is Slug.OVERDRAFT
        assert again == Refused(first.rejection, replayed=True)


def test_a_look_up_sees_what_stood_before_it_in_the_line(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        assert made.look_up("k") == KeyUnknown()
        done, found = made.write(order(opening("a"), "k"), LookUp("k", 0))
        assert isinstance(done, Done)
        assert found == Done(done.status, done.body, replayed=True)


def test_keys_outlive_their_core(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        done = made.write(order(opening("a"), "k"))[0]
    with pen(tmp_path) as heir:
        again = heir.look_up("k")
        assert isinstance(done, Done)
        assert again == Done(done.status, done.body, replayed=True)


def test_the_epoch_grows_by_one_per_fence(tmp_path: Path) -> None:
    connection = opened(tmp_path)
    assert fenced(connection, None) == Raised(1)
    assert fenced(connection, 1) == Raised(2)
    assert fenced(connection, 1) == Fenced(2)
    assert fenced(connection, 9) == StoreWentBack(2, 9)
    assert fenced(connection, None) == Raised(3)
    connection.close()
    connection.engine.dispose()


def test_a_missing_ledger_is_not_made_anew_for_a_core_that_has_a_predecessor(tmp_path: Path) -> None:
    connection = opened(tmp_path)
    assert fenced(connection, 4) == StoreWentBack(0, 4)
    assert fenced(connection, None) == Raised(1)
    connection.close()
    connection.engine.dispose()


def test_a_ledger_of_another_schema_is_left_alone(tmp_path: Path) -> None:
    pen(tmp_path).__enter__().close()
    tamper(tmp_path, "UPDATE meta SET schema_version = 99")
    connection = opened(tmp_path)
    assert fenced(connection, None) == NotOurs(99)
    assert connection.exec_driver_sql("SELECT epoch FROM meta").scalar_one() == 1
    connection.close()
    connection.engine.dispose()


def test_somebody_elses_database_is_left_alone(tmp_path: Path) -> None:
    other = sqlite3.connect(tmp_path / LEDGER_FILE)
    other.execute("CREATE TABLE recipes (name TEXT)")
    other.close()
    connection = opened(tmp_path)
    assert fenced(connection, None) == NotOurs(None)
    connection.close()
    connection.engine.dispose()


def test_a_file_that_is_no_database_is_damage(tmp_path: Path) -> None:
    (tmp_path / LEDGER_FILE).write_bytes(b"not a database " * 500)
    found = open_writing(tmp_path / LEDGER_FILE, 100)
    assert isinstance(found, StoreError)
    assert found.fault is StoreFault.DAMAGED


def test_a_fence_behind_somebody_elses_lock_is_busy(tmp_path: Path) -> None:
    with pen(tmp_path) as holder:
        connection = opened(tmp_path, busy_timeout_ms=20)
        holder.connection.exec_driver_sql("BEGIN IMMEDIATE")
        found = fenced(connection, None)
        holder.connection.exec_driver_sql("ROLLBACK")
        assert isinstance(found, StoreError)
        assert found.fault is StoreFault.BUSY
        connection.close()
        connection.engine.dispose()


def test_a_core_that_thaws_behind_a_fence_writes_nothing(tmp_path: Path) -> None:
    with pen(tmp_path) as old:
        old.carry_out(opening("a"), opening("b"))
        with pen(tmp_path) as new:
            assert old.journal.write([order(moving(5, "a", "b"), "k")]) == FencedBy(2)
            assert old.journal.write([LookUp("k", 0)]) == FencedBy(2)
            assert new.look_up("k") == KeyUnknown()
            assert accounts(new) == {"a": 0, "b": 0}


def test_a_batch_behind_somebody_elses_lock_is_not_begun_and_may_come_again(tmp_path: Path) -> None:
    with pen(tmp_path) as holder, pen(tmp_path, busy_timeout_ms=20) as made:
        holder.connection.exec_driver_sql("BEGIN IMMEDIATE")
        assert made.journal.write([order(opening("a"), "k")]) == NotBegun((StoreBusy(),))
        holder.connection.exec_driver_sql("ROLLBACK")
        assert isinstance(made.write(order(opening("a"), "k"))[0], Done)


def test_a_commit_that_raises_is_unknown_and_ends_the_journal(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"), opening("b"))
        failing_at_commit(made.connection)
        batch = [order(moving(1, "a", "b"), "k")]
        outcome = made.journal.write(batch)
        assert isinstance(outcome, Failed)
        assert set(outcome.answers) == {OutcomeUnknown()}
        with pytest.raises(AssertionError):
            made.journal.write(batch)


def test_a_store_without_room_before_commit_has_done_nothing_and_goes_on_once_there_is_room(
    tmp_path: Path,
) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"), opening("b"))
        before = made.write(order(moving(7, "a", "b"), "before"))[0]
        assert isinstance(before, Done)
        # A store with no room for one more page: SQLite says FULL to a statement and rolls back by itself.
        pages = made.connection.exec_driver_sql("PRAGMA page_count").scalar_one()
        made.connection.exec_driver_sql(f"PRAGMA max_page_count = {pages}")
        batch = [order(moving(1, "a", "b"), f"k{n}") for n in range(200)]
        outcome = made.journal.write(batch)
        assert isinstance(outcome, NotTaken)
        assert outcome.error.fault is StoreFault.NO_ROOM
        assert set(outcome.answers) == {ReadOnly("DISK_FULL")}
        assert accounts(made) == {"a": 7, "b": -7}
        made.connection.exec_driver_sql("PRAGMA max_page_count = 100000")
        assert all(isinstance(answer, Done) for answer in made.write(*batch))
        assert accounts(made) == {"a": 207, "b": -207}


def test_on_a_full_disk_what_is_known_is_still_told_and_what_is_new_is_not_done(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"), opening("b"))
        command = moving(5, "a", "b")
        first = made.write(order(command, "k"))[0]
        assert isinstance(first, Done)
        new = moving(1, "a", "b")
        made.journal.pretend_full(FOR_EVER_NS)
        outcome = made.journal.write(
            [order(command, "k"), order(moving(9, "a", "b"), "k"), LookUp("k", 0), order(new, "new")]
        )
        assert isinstance(outcome, NotTaken)
        again = Done(first.status, first.body, replayed=True)
        assert outcome.answers == (again, KeyTaken(), again, ReadOnly("DISK_FULL"))
        # What asks for no write needs no room.
        assert made.write(order(command, "k"), LookUp("new", 0)) == (again, KeyUnknown())
        made.journal.pretend_full(0)
        assert isinstance(made.write(order(new, "new"))[0], Done)


def test_a_touch_writes_nothing_that_can_be_seen_and_fails_on_a_full_disk(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"))
        head = queries.head(made.connection)
        made.journal.pretend_full(FOR_EVER_NS)
        refused = made.journal.write([Touch(0)])
        assert isinstance(refused, NotTaken)
        assert refused.answers == (ReadOnly("DISK_FULL"),)
        made.journal.pretend_full(0)
        assert isinstance(made.write(Touch(0))[0], Done)
        assert queries.head(made.connection) == head


def refusing_writes(made: Pen) -> None:
    """Have the store refuse the very BEGIN of a write, as one on a read-only disk."""
    made.connection.exec_driver_sql("PRAGMA query_only = ON").close()


def test_where_not_even_begin_is_taken_what_is_known_is_still_told(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        command = opening("a")
        first = made.write(order(command, "k"))[0]
        assert isinstance(first, Done)
        refusing_writes(made)
        outcome = made.journal.write([LookUp("k", 0), LookUp("new", 0), order(opening("b"))])
        assert isinstance(outcome, NotTaken)
        again = Done(first.status, first.body, replayed=True)
        assert outcome.answers == (again, KeyUnknown(), ReadOnly("DISK_READ_ONLY"))


def test_a_fenced_core_says_nothing_of_a_key_also_where_not_even_begin_is_taken(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"))
        successor = opened(tmp_path)
        assert fenced(successor, None) == Raised(2)
        successor.close()
        successor.engine.dispose()
        refusing_writes(made)
        assert made.journal.write([LookUp("k", 0), order(opening("b"), "k")]) == FencedBy(2)


def test_a_drill_that_does_nothing_itself_meets_the_full_disk(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.journal.pretend_full(FOR_EVER_NS)
        outcome = made.journal.write([Exercise(0, "drill", "system:drill", None)])
        assert isinstance(outcome, NotTaken)


def test_a_bug_in_deciding_one_command_leaves_the_others_alone(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"), opening("b"))
        broken = order(moving(1, "a", "b"))
        msgspec.structs.force_setattr(broken.command, "postings", None)
        failed, done = made.write(broken, order(moving(2, "a", "b")))
        assert isinstance(failed, DecisionFailed)
        assert isinstance(done, Done)
        assert accounts(made) == {"a": 2, "b": -2}


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE event SET body = x'00' WHERE seq = 1",
        "DELETE FROM event WHERE seq = 2",
        "UPDATE idempotency SET status = 200",
        "DELETE FROM idempotency",
        "UPDATE meta SET epoch = 0",
        "DELETE FROM meta",
        "INSERT INTO event SELECT 9, epoch, booked_ns, kind, command_id, key, body, hash FROM event WHERE seq = 1",
        "INSERT INTO event SELECT 3, 7, booked_ns, kind, command_id, key, body, hash FROM event WHERE seq = 1",
        "UPDATE account SET posted = -1 WHERE id = 'a'",
    ],
)
def test_the_store_itself_refuses_to_forget(tmp_path: Path, statement: str) -> None:
    with pen(tmp_path) as made:
        made.write(order(opening("a", no_overdraft=True), "k"), order(opening("b")))
        with pytest.raises(IntegrityError):
            made.connection.execute(text(statement))


def test_the_head_that_a_journal_shows_is_the_last_event(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"), opening("b"))
        assert made.journal.head_seq == 2
        assert (
            Journal(made.connection, 1, 2, NoRecorder(), Room(tmp_path, lambda: 0), lambda: 0).head_seq == 2
        )
