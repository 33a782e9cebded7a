"""Entries in the journal: all of an entry or nothing, once, provable, and known for ever."""

import asyncio
import sqlite3
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import pytest
from sqlalchemy.exc import IntegrityError

from core.journal import queries, register, schema
from core.journal.answers import Answer, Done, KeyTaken, Refused, status_of
from core.journal.fence import Raised
from core.journal.proof import Proven, Walk, prove
from core.journal.register import HouseholdFilter
from core.journal.store import LEDGER_FILE
from core.journal.writer import Writer
from core.ledger.decider import EVENTS_PER_COMMAND_MAX
from core.ledger.entries import Origin, RecordEntry
from core.ledger.events import Event
from core.ledger.reasons import Slug
from core.ledger.views import EntryView, tell
from tests.unit.core.books import (
    Pen,
    entering,
    fenced,
    moving,
    opened,
    opening,
    order,
    pen,
    replacing,
    reversing,
    tamper,
)
from tests.unit.core.test_verify import verdict

OLD_LEDGERS = Path(__file__).parent


def told(answer: Answer) -> Any:
    assert isinstance(answer, Done), answer
    return msgspec.json.decode(answer.body)


def told_bytes(answer: Answer) -> bytes:
    assert isinstance(answer, Done), answer
    return answer.body


def slug(answer: Answer) -> Slug:
    assert isinstance(answer, Refused), answer
    return answer.rejection.slug


def balances(made: Pen) -> dict[str, int]:
    return {account.name: account.posted for account in queries.all_accounts(made.connection)}


def entries(made: Pen) -> list[tuple[str, str]]:
    found = register.list_entries(made.connection, HouseholdFilter(limit=500), ())
    return [(entry.id, entry.amount) for entry in found]


def fingerprint(number: int) -> str:
    return f"{number:032x}"


def test_accounts_of_first_use_are_opened_with_their_entry_and_the_last_event_carries_the_key(
    tmp_path: Path,
) -> None:
    with pen(tmp_path) as made:
        command = entering("-12000", None, currency="KRW", category="식비", payment_method="현금")
        view = told(made.write(order(command, "k"))[0])
        rows = list(queries.event_rows(made.connection, 0))
        assert [row.kind for row in rows] == ["account.opened", "account.opened", "entry.posted"]
        assert [row.key for row in rows] == [None, None, "k"]
        assert len({row.command_id for row in rows}) == 1
        assert (view["id"], view["seq"], view["account_name"]) == (command.id, 3, "현금")
        assert balances(made) == {"현금": -12000, "식비": 12000}
    assert verdict(tmp_path).ok


def test_a_refused_entry_opens_nothing(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("bank", no_overdraft=True))
        assert slug(made.carry_out(entering("-1", category="식비"))[0]) is Slug.OVERDRAFT
        assert balances(made) == {"BANK": 0}


def test_two_entries_of_one_batch_make_their_category_once(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(
            opening("bank"), *[entering("-1", category=name) for name in ("Food", " food", "FOOD")]
        )
        made.carry_out(entering("-1", category="fOOD"))
        assert balances(made) == {"BANK": -4, "Food": 4}


def test_an_account_that_is_opened_in_the_same_batch_lends_its_currency(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        taken = opening("expense:food:usd", currency="USD")
        answers = made.carry_out(taken, opening("bank", currency="USD"), entering("-1.5", category="food"))
        assert told(answers[2])["amount"] == "-1.50"
        assert told(answers[2])["category_account"] != taken.id


def test_an_entry_can_be_written_changed_and_reversed_in_one_batch(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        command = entering("-5", category="식비")
        answers = made.carry_out(
            opening("bank"),
            command,
            replacing(command.id, "-7", category="교통"),
            reversing(command.id),
            reversing(command.id),
        )
        assert [type(answer) for answer in answers] == [Done] * 4 + [Refused]
        assert told(answers[2])["id"] == told(answers[3])["id"] == command.id
        assert told(answers[3])["reverses"] == told(answers[2])["transaction"]
        assert set(balances(made).values()) == {0}
        assert entries(made) == []
    assert verdict(tmp_path).ok


def test_a_change_keeps_the_id_and_everything_that_ever_stood(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("bank"))
        command = entering("-5", category="식비", description="lunch")
        first = told(made.carry_out(command)[0])
        changed = told(made.carry_out(replacing(command.id, "-6", category="식비", date="2026-11-20"))[0])
        assert register.get_entry(made.connection, command.id, ()) == msgspec.convert(changed, type=EntryView)
        assert entries(made) == [(command.id, "-6")]
        kept = queries.list_transactions(made.connection, queries.TransactionFilter(), ())
        assert [(one.reverses, one.entry) for one in kept] == [
            (None, command.id),
            (first["transaction"], command.id),
            (None, command.id),
        ]
        assert [one.date for one in kept] == ["2026-11-20", "2026-11-21", "2026-11-21"]


def test_no_command_books_more_events_than_a_listeners_line_is_measured_by(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("bank"))
        command = entering("-5")
        made.carry_out(command)
        before = made.journal.head_seq
        most = replacing(command.id, "6", None, currency="USD", payment_method="cash", category="gifts")
        made.carry_out(most)
        assert made.journal.head_seq - before == EVENTS_PER_COMMAND_MAX


def test_entries_are_written_changed_and_reversed_once_per_key(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("bank"))
        command = entering("-5", category="식비")
        for key, wish in (
            ("k1", command),
            ("k2", replacing(command.id, "-6")),
            ("k3", reversing(command.id)),
        ):
            first = made.write(order(wish, key))[0]
            again = made.write(order(wish, key))[0]
            assert isinstance(first, Done)
            assert again == Done(first.status, first.body, replayed=True)
        assert made.write(order(entering("-50", category="식비"), "k1")) == (KeyTaken(),)
        refused = made.write(order(reversing(command.id), "k4"), order(reversing(command.id), "k4"))
        assert [slug(answer) for answer in refused] == [Slug.ENTRY_REVERSED] * 2
        assert status_of(slug(refused[0])) == 409
    assert verdict(tmp_path).ok


def test_a_wish_for_what_was_seen_is_refused_once_something_else_stands(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("bank"))
        command = entering("-5", category="식비")
        seen = told(made.carry_out(command)[0])["seq"]
        first = replacing(command.id, "-6", expected_seq=seen)
        answers = made.write(
            order(first, "k1"),
            order(replacing(command.id, "-7", expected_seq=seen), "k2"),
            order(reversing(command.id, seen), "k3"),
        )
        assert [slug(answer) for answer in answers[1:]] == [Slug.ENTRY_CHANGED] * 2
        assert status_of(slug(answers[1])) == 409
        assert entries(made) == [(command.id, "-6")]
        stands = told(answers[0])["seq"]
        gone = made.carry_out(reversing(command.id, stands))[0]
        assert isinstance(gone, Done)
        again = made.write(order(first, "k1"))[0]
        assert isinstance(again, Done)
        assert (again.body, again.replayed) == (told_bytes(answers[0]), True)
        assert slug(made.carry_out(reversing(command.id, stands))[0]) is Slug.ENTRY_REVERSED
    assert verdict(tmp_path).ok


def test_a_change_that_keeps_the_rest_keeps_what_stands_when_it_is_booked(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("bank"))
        command = entering("-5", payment_method="card", tags=["home"])
        made.carry_out(command, replacing(command.id, "-6", payment_method="cash", tags=["trip"]))
        kept = told(made.carry_out(replacing(command.id, "-7", keeps_the_rest=True))[0])
        assert (kept["amount"], kept["payment_method"], kept["tags"]) == ("-7", "cash", ["trip"])


def test_a_row_of_a_file_is_booked_once_however_often_it_comes(tmp_path: Path) -> None:
    def row(number: int, import_id: str = "i", **wanted: Any) -> RecordEntry:
        return entering("-1", origin=Origin(import_id, number, fingerprint(number)), **wanted)

    with pen(tmp_path) as made:
        made.carry_out(opening("bank"))
        first = row(1)
        answers = made.write(order(first, "i:1"), order(row(1, "other"), "other:1"), order(row(2), "i:2"))
        assert [type(answer) for answer in answers] == [Done, Refused, Done]
        assert slug(answers[1]) is Slug.ALREADY_IMPORTED
        made.carry_out(reversing(first.id))
        assert slug(made.carry_out(row(1, "third"))[0]) is Slug.ALREADY_IMPORTED
        assert isinstance(made.carry_out(row(1, "third", duplicates_wanted=True))[0], Done)
        asked = [fingerprint(number) for number in range(1, 5)]
        assert queries.known_fingerprints(made.connection, asked) == {fingerprint(1), fingerprint(2)}
        assert queries.known_fingerprints(made.connection, []) == set()
    assert verdict(tmp_path).ok


def test_the_tail_of_a_book_with_entries_is_proven_with_keys_on_last_events_alone(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("bank"))
        for number in range(5):
            command = entering("-5", category=f"c{number}")
            made.write(order(command, f"a{number}"), order(replacing(command.id, "6"), f"b{number}"))
        for start in (0, 1, 2, 3, 7):
            walk = Walk(None, queries.event_row(made.connection, start))
            assert isinstance(prove(queries.read_tail(made.connection, walk, ()), ()), Proven)


def household(path: Path) -> None:
    """Events: 1 bank, 2-3 식비 and entry, 4-6 reversal, 교통 and change, 7-8 급여 and entry, 9 its reversal."""
    with pen(path) as made:
        first = entering("-5", category="식비", origin=Origin("i", 1, fingerprint(1)))
        second = entering("9", category="급여")
        made.carry_out(opening("bank"))
        made.write(order(first, "k1"), order(replacing(first.id, "-7", category="교통"), "k2"))
        made.write(order(second, "k3"), order(reversing(second.id), "k4"))


def test_a_household_is_proven_in_slices_of_any_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    household(tmp_path)
    for slice_events in (1, 2, 3, 4, 9):
        monkeypatch.setattr("core.journal.verify.SLICE_EVENTS", slice_events)
        found = verdict(tmp_path)
        assert found.ok, (slice_events, found.reason)
        assert found.events == 9


@pytest.mark.parametrize(
    ("statement", "first_bad_seq"),
    [
        ("UPDATE posting SET standing = 1 WHERE seq = 3", 3),
        ("UPDATE posting SET standing = 0 WHERE seq = 6", 6),
        ("UPDATE posting SET standing = 1 WHERE seq = 4 AND line = 1", 4),
        ("UPDATE posting SET date = '2026-11-20' WHERE seq = 6 AND line = 0", 6),
        ("UPDATE reversal SET reversed_seq = 6 WHERE seq = 4", 3),
        ("DELETE FROM reversal WHERE seq = 9", 8),
        ("INSERT INTO reversal VALUES (8, 6)", 6),
        ("UPDATE entry SET date = '2026-01-01' WHERE seq = 6", 6),
        ("UPDATE entry SET reversed = 0 WHERE seq = 8", 8),
        ("DELETE FROM entry WHERE seq = 6", 6),
        ("DELETE FROM entry WHERE seq = 8", None),
        ("UPDATE entry SET category_id = 'bank' WHERE seq = 6", 6),
        ("DELETE FROM origin", 3),
        ("UPDATE origin SET fingerprint = 'other'", 3),
        ("INSERT INTO origin VALUES (8, 'other')", 8),
        ("INSERT INTO origin VALUES (99, 'other')", 99),
        ("DELETE FROM account_name WHERE account_id = 'bank'", None),
        ("UPDATE account_name SET folded = 'other' WHERE account_id = 'bank'", None),
    ],
)
def test_every_way_to_falsify_a_household_is_found(
    tmp_path: Path, statement: str, first_bad_seq: int | None
) -> None:
    household(tmp_path)
    tamper(tmp_path, statement)
    found = verdict(tmp_path)
    assert not found.ok
    assert found.first_bad_seq == first_bad_seq, found.reason


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE reversal SET reversed_seq = 1",
        "DELETE FROM reversal",
        "INSERT INTO reversal VALUES (6, 3)",
        "UPDATE origin SET fingerprint = 'x'",
        "DELETE FROM origin",
    ],
)
def test_the_store_itself_refuses_to_forget_reversals_and_rows(tmp_path: Path, statement: str) -> None:
    household(tmp_path)
    connection = opened(tmp_path)
    with pytest.raises(IntegrityError):
        connection.exec_driver_sql(statement)
    connection.close()
    connection.engine.dispose()


def test_who_listens_is_told_what_was_committed_after_it_was_answered(tmp_path: Path) -> None:
    async def scenario() -> None:
        made = Pen(tmp_path)
        nothing: list[object] = []
        writer = Writer(
            made.journal,
            made.recorder,
            asyncio.get_running_loop(),
            on_shut=nothing.append,
            on_failed=nothing.append,
            on_fenced=nothing.append,
            on_bug=nothing.append,
        )
        heard: list[tuple[int, Event]] = []
        answered: list[asyncio.Future[Answer]] = []

        def listen(events: Sequence[tuple[int, Event]]) -> None:
            assert all(future.done() for future in answered)
            heard.extend(events)

        writer.start()
        await writer.submit(order(opening("bank"), slot=slot(made)))
        writer.listen(listen)
        answered.append(writer.submit(order(entering("-1", category="식비"), "k", slot(made))))
        answered.append(writer.submit(order(entering("-1", "nobody"), slot=slot(made))))
        await asyncio.gather(*answered)
        writer.listen(None)
        await writer.submit(order(entering("-1", category="식비"), slot=slot(made)))
        await writer.stop()
        made.recorder.close()
        assert [seq for seq, _ in heard] == [2, 3]
        said = [tell(event, seq) for seq, event in heard]
        assert [(event.kind, event.date) for event in said] == [
            ("account.opened", None),
            ("entry.posted", "2026-11-21"),
        ]
        assert said[1].accounts == ("bank", said[0].id)
        reading = opened(tmp_path)
        assert queries.committed_after(reading, 1, 2) == said
        reading.close()
        reading.engine.dispose()
        assert not nothing

    asyncio.run(scenario())


def slot(made: Pen) -> int:
    taken = made.recorder.begin("c", None, "test", "", (), b"", 0)
    assert taken is not None
    return taken


def old_ledger(path: Path, version: int = 2) -> None:
    connection = sqlite3.connect(path / LEDGER_FILE, isolation_level=None)
    connection.executescript((OLD_LEDGERS / f"ledger_of_version_{version}.sql").read_text())
    connection.close()


def test_a_household_that_kept_its_ledger_before_there_were_entries_finds_everything(tmp_path: Path) -> None:
    old_ledger(tmp_path)
    with pen(tmp_path) as made:
        assert made.epoch == 2
        assert balances(made) == {"주거래 통장": 2_988_000, "식비": 12_000, "급여": -3_000_000, "Old": 0}
        assert told(made.look_up("k1"))["description"] == "급여"
        assert slug(made.look_up("k3")) is Slug.OVERDRAFT
        lines = register.list_register(made.connection, HouseholdFilter(account="assets:bank"), ())
        assert [(line.date, line.balance) for line in lines] == [
            ("2026-10-26", "2988000"),
            ("2026-10-25", "3000000"),
        ]
        entry = told(made.carry_out(entering("-2000", "assets:bank", category="식비"))[0])
        assert entry["category_account"] == "expenses:food"
        month = register.summary_of(made.connection, "2026-10", "2026-10-01", "2026-10-31")
        assert [(flow.income, flow.expense) for flow in month.currencies if flow.currency == "KRW"] == [
            ("3000000", "12000")
        ]
    assert verdict(tmp_path).ok


def test_the_step_from_an_older_ledger_ends_at_the_layout_of_a_new_one(tmp_path: Path) -> None:
    def layout(connection: sqlite3.Connection) -> dict[str, Any]:
        names = connection.execute("SELECT name, type, tbl_name FROM sqlite_master WHERE sql IS NOT NULL")
        return {
            name: (kind, table, connection.execute(f"PRAGMA {kind}_xinfo({name})").fetchall())
            for name, kind, table in names.fetchall()
        }

    layouts = []
    for version in (2, 3, 4, None):
        folder = tmp_path / str(version)
        folder.mkdir()
        if version is not None:
            old_ledger(folder, version)
        pen(folder).__enter__().close()
        connection = sqlite3.connect(folder / LEDGER_FILE)
        layouts.append(layout(connection))
        connection.close()
    assert layouts[0] == layouts[1] == layouts[2] == layouts[3]


def test_an_older_ledger_is_not_touched_by_a_core_that_is_fenced(tmp_path: Path) -> None:
    old_ledger(tmp_path)
    connection = opened(tmp_path)
    assert not isinstance(fenced(connection, 7), Raised)
    version = connection.exec_driver_sql("SELECT schema_version FROM meta").scalar_one()
    tables = connection.exec_driver_sql(
        "SELECT count(*) FROM sqlite_master WHERE name = 'entry'"
    ).scalar_one()
    assert (version, tables) == (2, 0)
    assert fenced(connection, 1) == Raised(2)
    version = connection.exec_driver_sql("SELECT schema_version FROM meta").scalar_one()
    assert version == schema.SCHEMA_VERSION
    connection.close()
    connection.engine.dispose()


def test_bare_transactions_and_entries_live_in_one_book(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("bank"), opening("cash"), moving(7, "cash", "bank"), entering("-2", "cash"))
        assert balances(made)["CASH"] == 5
    assert verdict(tmp_path).ok
