"""The journal in a PostgreSQL server: the same rules as in a file, and those that only a server has.

The tests that are named below are those of the file, run again with their books in a server.
"""

from collections.abc import Iterator
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from sqlalchemy import Connection
from sqlalchemy.exc import DBAPIError, IntegrityError

from core.journal import queries
from core.journal.answers import Done, KeyUnknown, OutcomeUnknown, Refused, StoreBusy
from core.journal.append import Committed, Failed, FencedBy, Journal, NotBegun, NotTaken
from core.journal.fence import Fenced, FenceOutcome, NotOurs, Raised, StoreWentBack
from core.journal.room import Room
from core.journal.store import (
    Server,
    StoreError,
    StoreFault,
    begin_reading,
    begin_writing,
    close_writing,
    commit,
    end_holders,
    is_interrupted,
    open_reading,
    server_at,
    snapshot,
    take_seat,
    writing,
)
from core.journal.verify import verify
from tests import postgres, waiting
from tests.unit.core import books, test_verify
from tests.unit.core.books import fenced, moving, opening, order, pen
from tests.unit.core.test_entries import (
    test_a_row_of_a_file_is_booked_once_however_often_it_comes,
    test_accounts_of_first_use_are_opened_with_their_entry_and_the_last_event_carries_the_key,
    test_an_entry_can_be_written_changed_and_reversed_in_one_batch,
    test_entries_are_written_changed_and_reversed_once_per_key,
)
from tests.unit.core.test_journal import (
    test_a_key_is_answered_twice_and_carried_out_once,
    test_a_key_that_belongs_to_another_wish_is_refused,
    test_a_look_up_sees_what_stood_before_it_in_the_line,
    test_a_refusal_by_the_book_is_kept_under_its_key,
    test_keys_outlive_their_core,
    test_two_commands_of_one_batch_cannot_spend_the_same_money,
)
from tests.unit.core.test_register import (
    test_a_month_is_summed_by_the_days_of_its_entries,
    test_a_search_in_entries_finds_the_same,
    test_balances_are_exact_where_sums_would_leave_64_bits,
    test_categories_are_listed_with_the_day_they_were_last_used,
    test_pages_of_a_register_join_without_gap_or_repeat_while_it_grows,
    test_the_register_of_all_accounts_shows_each_with_its_own_balance,
)

__all__ = [
    "test_a_key_is_answered_twice_and_carried_out_once",
    "test_a_key_that_belongs_to_another_wish_is_refused",
    "test_a_look_up_sees_what_stood_before_it_in_the_line",
    "test_a_month_is_summed_by_the_days_of_its_entries",
    "test_a_refusal_by_the_book_is_kept_under_its_key",
    "test_a_row_of_a_file_is_booked_once_however_often_it_comes",
    "test_a_search_in_entries_finds_the_same",
    "test_accounts_of_first_use_are_opened_with_their_entry_and_the_last_event_carries_the_key",
    "test_an_entry_can_be_written_changed_and_reversed_in_one_batch",
    "test_balances_are_exact_where_sums_would_leave_64_bits",
    "test_categories_are_listed_with_the_day_they_were_last_used",
    "test_entries_are_written_changed_and_reversed_once_per_key",
    "test_keys_outlive_their_core",
    "test_pages_of_a_register_join_without_gap_or_repeat_while_it_grows",
    "test_the_register_of_all_accounts_shows_each_with_its_own_balance",
    "test_two_commands_of_one_batch_cannot_spend_the_same_money",
]

READ_MS = 5_000
SHORT_MS = 30


@pytest.fixture(scope="module")
def server() -> Iterator[postgres.Postgres]:
    with postgres.served() as made:
        yield made


@pytest.fixture
def place(server: postgres.Postgres) -> Server:
    found = server_at(server.place())
    assert isinstance(found, Server)
    return found


@pytest.fixture(autouse=True)
def books_lie_in_the_server(place: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    def opened(_: Path, busy_timeout_ms: int = 1_000) -> Connection:
        return connected(place, busy_timeout_ms)

    monkeypatch.setattr(books, "opened", opened)
    monkeypatch.setattr(test_verify, "open_reading", lambda _, *how: open_reading(place, *how))


def connected(place: Server, busy_timeout_ms: int = 1_000) -> Connection:
    connection = writing(place).connect(busy_timeout_ms)
    assert not isinstance(connection, StoreError), connection
    return connection


@pytest.fixture
def two(place: Server) -> Iterator[tuple[Connection, Connection]]:
    """An old core's connection and that of its successor, to a ledger of epoch 1."""
    old, new = connected(place), connected(place, SHORT_MS)
    assert isinstance(fenced(old, None), Raised)
    yield old, new
    for connection in (old, new):
        close_writing(connection)


def lost(server: postgres.Postgres, connection: Connection) -> None:
    """End the session of a connection, as a server that is stopped would."""
    driver: Any = connection.connection.driver_connection
    pid = driver.info.backend_pid
    server.ask(f"SELECT pg_terminate_backend({pid})")
    waiting.until(
        lambda: server.ask(f"SELECT count(*) FROM pg_stat_activity WHERE pid = {pid}") == [(0,)],
        "the session to be over",
    )


@pytest.mark.parametrize("lock", ["FOR SHARE", "FOR UPDATE"])
def test_a_fence_waits_for_a_batch_that_holds_its_row(two: tuple[Connection, Connection], lock: str) -> None:
    old, new = two
    old.exec_driver_sql("BEGIN").close()
    old.exec_driver_sql(f"SELECT epoch FROM meta {lock}").close()
    outcome = fenced(new, 1)
    assert isinstance(outcome, StoreError)
    assert outcome.fault is StoreFault.BUSY


@pytest.mark.parametrize("lock", ["", "FOR KEY SHARE"])
def test_a_look_at_the_epoch_that_holds_nothing_would_let_an_old_entry_in(place: Server, lock: str) -> None:
    old, new = connected(place), connected(place)
    fenced(old, None)
    old.exec_driver_sql("BEGIN").close()
    assert old.exec_driver_sql(f"SELECT epoch FROM meta {lock}").scalar() == 1
    # What the batch takes is too little: another core is through its fence, and this one could go on to its COMMIT.
    new.exec_driver_sql("BEGIN").close()
    new.exec_driver_sql("UPDATE meta SET head_seq = head_seq").close()
    new.exec_driver_sql("COMMIT").close()
    for connection in (old, new):
        close_writing(connection)


def test_an_epoch_that_is_read_in_an_older_snapshot_is_the_old_one(place: Server) -> None:
    old, new = connected(place), connected(place)
    fenced(old, None)
    begin_reading(old)  # one moment for all of it: what a batch must never be
    old.exec_driver_sql("SELECT 1 FROM meta").close()
    assert fenced(new, 1) == Raised(2)
    assert old.exec_driver_sql("SELECT epoch FROM meta").scalar() == 1
    old.exec_driver_sql("ROLLBACK").close()
    begin_writing(old)
    assert old.exec_driver_sql("SELECT epoch FROM meta").scalar() == 2
    for connection in (old, new):
        close_writing(connection)


def test_a_batch_that_waits_for_a_fence_sees_its_epoch(place: Server, tmp_path: Path) -> None:
    new = connected(place)
    with pen(tmp_path, 10_000) as made:
        new.exec_driver_sql("BEGIN").close()
        new.exec_driver_sql("UPDATE meta SET epoch = epoch + 1").close()
        outcomes: list[object] = []
        waiter = Thread(target=lambda: outcomes.append(made.journal.write([order(opening("a"))])))
        waiter.start()
        waiting.until(
            lambda: new.exec_driver_sql("SELECT count(*) FROM pg_locks WHERE NOT granted").scalar(),
            "the batch to wait for the row",
        )
        commit(new)
        waiter.join()
        assert outcomes == [FencedBy(2)]
        assert queries.head(new).head_seq == 0
    close_writing(new)


def test_a_frozen_core_is_made_to_let_go_and_what_it_had_begun_is_gone(
    two: tuple[Connection, Connection],
) -> None:
    old, new = two
    begin_writing(old)
    old.exec_driver_sql("UPDATE meta SET head_seq = 7").close()
    assert isinstance(fenced(new, 1), StoreError)
    assert end_holders(new)
    assert fenced(new, 1) == Raised(2)
    with pytest.raises(DBAPIError):
        commit(old)
    assert queries.head(new).head_seq == 0


def test_only_a_core_that_holds_the_row_is_made_to_let_go(
    two: tuple[Connection, Connection], server: postgres.Postgres
) -> None:
    old, new = two
    with server.connect() as somebody:
        somebody.execute("SELECT 1")
        assert not end_holders(new)
        assert somebody.execute("SELECT 1").fetchone() == (1,)
    assert old.exec_driver_sql("SELECT 1").scalar() == 1


def test_two_cores_that_found_a_ledger_at_once_found_one(place: Server) -> None:
    first, second = connected(place), connected(place, 10_000)
    outcomes: list[FenceOutcome] = []
    threads = [Thread(target=lambda one=one: outcomes.append(fenced(one, None))) for one in (first, second)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(outcomes, key=str) == [Raised(1), Raised(2)]
    for connection in (first, second):
        close_writing(connection)


def test_a_core_that_runs_alone_keeps_others_from_its_database(place: Server) -> None:
    alone, other = connected(place), connected(place, SHORT_MS)
    assert take_seat(alone, shared=False) is None
    refused = take_seat(other, shared=True)
    assert isinstance(refused, StoreError)
    assert refused.fault is StoreFault.BUSY
    close_writing(alone)
    assert waiting.until(lambda: take_seat(other, shared=True) is None, "the seat to be free")
    close_writing(other)


def test_an_epoch_that_was_not_expected_is_said(two: tuple[Connection, Connection]) -> None:
    old, _ = two
    assert fenced(old, 0) == Fenced(1)
    assert fenced(old, 5) == StoreWentBack(1, 5)


def test_somebody_elses_tables_are_left_alone(place: Server) -> None:
    connection = connected(place)
    connection.exec_driver_sql("CREATE TABLE theirs (id int)").close()
    assert fenced(connection, None) == NotOurs(None)
    close_writing(connection)


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE event SET kind = 'x'",
        "DELETE FROM event",
        "TRUNCATE event CASCADE",
        "DELETE FROM meta",
        "UPDATE meta SET epoch = 0",
        "UPDATE idempotency SET status = 1",
        "INSERT INTO event SELECT seq + 2, epoch, booked_ns, kind, command_id, NULL, body, hash FROM event LIMIT 1",
        "INSERT INTO event SELECT seq + 1, 9, booked_ns, kind, command_id, NULL, body, hash FROM event LIMIT 1",
    ],
)
def test_the_server_itself_refuses_to_forget(tmp_path: Path, statement: str) -> None:
    with pen(tmp_path) as made:
        made.write(order(opening("a"), "k"))
        with pytest.raises(IntegrityError):
            made.connection.exec_driver_sql(statement)


def test_a_connection_lost_between_two_batches_costs_nothing(
    server: postgres.Postgres, tmp_path: Path
) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"), opening("b"))
        lost(server, made.connection)
        assert isinstance(made.carry_out(moving(5, "a", "b"))[0], Done)
        assert queries.head(made.connection).head_seq == 3


def test_a_connection_lost_before_commit_has_done_nothing_and_the_next_batch_goes_on(
    server: postgres.Postgres, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"), opening("b"))
        store = Journal._store

        def cut(journal: Journal, *batch: Any) -> None:
            lost(server, made.connection)
            store(journal, *batch)

        monkeypatch.setattr(Journal, "_store", cut)
        work = order(moving(5, "a", "b"), "k")
        outcome = made.journal.write([work])
        assert outcome == NotBegun((StoreBusy(),))
        monkeypatch.undo()
        assert made.look_up("k") == KeyUnknown()
        assert isinstance(made.write(work)[0], Done)
        assert queries.head(made.connection).head_seq == 3


def test_a_connection_lost_in_commit_leaves_an_unknown_outcome_and_no_more_batches(
    server: postgres.Postgres, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pen(tmp_path) as made:

        def cut(connection: Connection) -> None:
            commit(connection)
            lost(server, connection)
            connection.exec_driver_sql("SELECT 1").close()

        monkeypatch.setattr("core.journal.append.commit", cut)
        outcome = made.journal.write([order(opening("a"))])
        assert isinstance(outcome, Failed)
        assert outcome.answers == (OutcomeUnknown(),)
        with pytest.raises(AssertionError):
            made.journal.write([])


def test_a_name_that_no_server_could_hold_is_not_there_and_costs_the_others_nothing(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        refused, done = made.carry_out(books.closing("a\0"), opening("a"))
        assert isinstance(refused, Refused)
        assert isinstance(done, Done)


def test_a_store_that_was_put_back_while_its_core_lives_is_not_written_on(
    place: Server, tmp_path: Path
) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"), opening("b"))
        somebody = connected(place)
        for statement in (
            "SET session_replication_role = replica",  # no trigger stands in the way of who restores
            "DELETE FROM event WHERE seq = 2",
            "UPDATE meta SET head_seq = 1",
        ):
            somebody.exec_driver_sql(statement).close()
        close_writing(somebody)
        outcome = made.journal.write([order(opening("c"))])
        assert isinstance(outcome, NotTaken)
        assert outcome.error.fault is StoreFault.DAMAGED
        assert queries.head(made.connection).head_seq == 1


def test_a_server_that_is_away_is_said_to_be(tmp_path: Path) -> None:
    nowhere = server_at(f"postgresql://keeper:hidden@/ledger?host={tmp_path}")
    assert isinstance(nowhere, Server)
    error = writing(nowhere).connect(SHORT_MS)
    assert isinstance(error, StoreError)
    assert error.fault is StoreFault.AWAY
    assert "hidden" not in f"{error}{nowhere}{nowhere!r}{[nowhere]}"


@pytest.mark.parametrize(
    ("setting", "why"), [("synchronous_commit", "synchronous_commit"), ("full_page_writes", None)]
)
def test_a_session_flushes_its_commits_whatever_its_server_says(
    server: postgres.Postgres, place: Server, setting: str, why: str | None
) -> None:
    server.ask(f"ALTER SYSTEM SET {setting} = off")
    server.ask("SELECT pg_reload_conf()")
    try:
        waiting.until(lambda: server.ask(f"SHOW {setting}") == [("off",)], "the setting to be in force")
        found = writing(place).connect(SHORT_MS)
        if why is None:
            assert isinstance(found, StoreError)
            assert found.fault is StoreFault.UNFIT
        else:
            assert isinstance(found, Connection)
            assert found.exec_driver_sql(f"SHOW {why}").scalar() == "on"
            close_writing(found)
    finally:
        server.ask(f"ALTER SYSTEM RESET {setting}")
        server.ask("SELECT pg_reload_conf()")


def test_readers_cannot_write_and_are_ended_when_they_take_too_long(place: Server, tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"))
        readers = open_reading(place, 1, SHORT_MS)
        with snapshot(readers, READ_MS) as connection, pytest.raises(DBAPIError):
            connection.exec_driver_sql("DELETE FROM meta")
        with snapshot(readers, SHORT_MS) as connection, pytest.raises(DBAPIError) as raised:
            connection.exec_driver_sql("SELECT pg_sleep(60)")
        assert is_interrupted(raised.value)
        readers.dispose()


def test_the_whole_proof_holds_and_finds_what_somebody_with_a_database_tool_has_done(
    place: Server, tmp_path: Path
) -> None:
    readers = open_reading(place, 1, SHORT_MS)
    with pen(tmp_path) as made:
        made.carry_out(opening("a"), opening("b"), moving(5, "a", "b"))
        whole = verify(readers, READ_MS, lambda: False)
        assert getattr(whole, "ok", None) is True, whole
        made.connection.exec_driver_sql("UPDATE account SET posted = posted + 1 WHERE id = 'a'").close()
    falsified = verify(readers, READ_MS, lambda: False)
    assert getattr(falsified, "ok", None) is False, falsified
    readers.dispose()


def test_names_are_in_the_order_of_their_bytes_whatever_the_servers_language(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(*[opening(name) for name in ("b", "A", "a-b", "ab", "_", "Z")])
        listed = [account.id for account in queries.list_accounts(made.connection, None, 10)]
        assert listed == sorted(listed)
        assert [one.id for one in queries.list_accounts(made.connection, "Z", 10)] == ["_", "a-b", "ab", "b"]


def test_a_place_for_a_ledger_is_told_of_without_its_password() -> None:
    for text in (
        "mysql://keeper:hidden@h/d",
        "postgresql://keeper:hidden@h",
        "postgresql://keeper:hidden@h:p/d",
    ):
        refused = server_at(text)
        assert isinstance(refused, str)
        assert "hidden" not in refused


def test_a_journal_in_a_server_needs_no_room_beside_it(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.journal = Journal(
            made.connection, made.epoch, 0, made.recorder, Room(None, lambda: 0), lambda: 1
        )
        assert isinstance(made.journal.write([order(opening("a"))]), Committed)
