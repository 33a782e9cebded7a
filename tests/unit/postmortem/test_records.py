import errno
import json
import os
import sqlite3
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace
from sqlalchemy import text

from postmortem import found_rules, intake
from postmortem.dead_letters import slip as slips
from postmortem.dead_letters import spool
from postmortem.dead_letters.life import Trigger
from postmortem.records import letters, log, stories
from postmortem.records.opening import Records, RecordsFailed, open_records
from postmortem.records.reads import Archive
from postmortem.records.stories import Proposed, Story
from postmortem.views import Act, Filter, IncidentLine, LetterState, Refusal, Standing
from tests.unit.postmortem.letter_slips import slip

NOW = "2026-11-22T15:00:00.000Z"


@pytest.fixture
def records(tmp_path: Path) -> Iterator[Records]:
    opened = open_records(tmp_path / "hardcore.db")
    assert isinstance(opened, Records)
    yield opened
    opened.close()


@pytest.fixture
def archive(records: Records, tmp_path: Path) -> Archive:
    return Archive(records, tmp_path / "rule_hits.json")


def _story(number: int, **fields: Any) -> Story:
    line = IncidentLine(
        id=f"i{number:05}",
        opened_at=f"2026-11-{1 + number // 1440 % 28:02}T{number // 60 % 24:02}:{number % 60:02}:00.000Z",
        closed_at=NOW,
        diagnosis="CRASHED",
        grade="certain",
        summary={"ko": "멈췄어요.", "en": "It died."},
        outcome="recovered",
        outage_ms=100.0 + number,
        detected_ms=1.0,
        fingerprint="f1",
        account_ids=("assets:cash",),
        planned=False,
        drill=None,
    )
    rule = {"type": "fingerprint", "fingerprint": "f" * 64}
    proposal = Proposed("fingerprint", {"ko": "막기", "en": "Refuse it"}, rule, None)
    return Story(replace(line, **fields), {"ko": "멈춤", "en": "Deaths"}, ("SIGSEGV",), (proposal,))


def _put(records: Records, *told: Story) -> None:
    with records.writing() as connection:
        for one in told:
            stories.put(connection, one, "mark")


def _take(records: Records, **fields: Any) -> str:
    read = slips.letter(slip(**fields))
    assert read is not None
    with records.writing() as connection:
        return letters.take(connection, read)


def test_an_incident_counts_once_however_often_it_is_read(records: Records, archive: Archive) -> None:
    for _ in range(3):
        _put(records, _story(1))
    _put(records, _story(1, closed_at=None), _story(1))
    found = archive.group("f1")
    assert found is not None
    assert (found.count, found.standing) == (1, Standing.NEW)
    assert archive.incidents(Filter(), 10).total == 1
    assert len(archive.proposals("i00001")) == 1


def test_a_death_after_somebody_called_it_fixed_is_back(records: Records, archive: Archive) -> None:
    _put(records, _story(1), _story(2))
    before = archive.group("f1")
    assert before is not None
    assert before.standing is Standing.KNOWN
    with records.writing() as connection:
        assert stories.mark_fixed(connection, "f1", "1.2", "2026-11-10T00:00:00.000Z")
    _put(records, _story(3))  # an older one that is read late
    late = archive.group("f1")
    assert late is not None
    assert late.standing is Standing.FIXED
    _put(records, _story(4, opened_at="2026-11-11T00:00:00.000Z"))
    again = archive.group("f1")
    assert again is not None
    assert (again.standing, again.newest, again.fixed_in) == (Standing.BACK, "i00004", "1.2")


def test_an_incident_that_is_understood_later_leaves_its_old_group(
    records: Records, archive: Archive
) -> None:
    _put(records, _story(1, fingerprint="open"), _story(1))
    assert archive.group("open") is None
    assert archive.group("f1") is not None


def test_lists_go_on_where_they_stopped(records: Records, archive: Archive) -> None:
    _put(records, *(_story(number, account_ids=(f"a{number % 2}",)) for number in range(25)))
    seen, cursor = [], ""
    while True:
        page = archive.incidents(Filter(account="a1"), 5, cursor)
        seen += [one.id for one in page.items]
        if page.more is None:
            break
        cursor = page.more
    assert seen == [f"i{number:05}" for number in range(23, 0, -2)]
    assert page.total == 12


@pytest.mark.parametrize("cursor", ["", "x", "|", "a|b", "'; drop table incidents", "|" * 9_999])
def test_a_strange_cursor_breaks_nothing(archive: Archive, cursor: str) -> None:
    for read in (archive.incidents, archive.groups, archive.letters):
        read(Filter(), 5, cursor)
    archive.audit(5, cursor)


@pytest.mark.parametrize(
    ("table", "where", "order"),
    [
        ("incidents", "", "opened_at DESC, id DESC"),
        ("incidents", "WHERE fingerprint = 'x'", "opened_at DESC"),
        ("incidents", "WHERE diagnosis = 'x'", "opened_at DESC"),
        ("groups", "", "last_at DESC, fingerprint DESC"),
        ("letters", "", "quarantined_at DESC, id DESC"),
        ("letters", "WHERE state = 'x'", "quarantined_at DESC, id DESC"),
    ],
)
def test_every_list_is_read_in_the_order_of_an_index(
    records: Records, table: str, where: str, order: str
) -> None:
    asked = f"EXPLAIN QUERY PLAN SELECT * FROM {table} {where} ORDER BY {order} LIMIT 50"
    with records.reading() as connection:
        plan = " ".join(str(row[3]) for row in connection.execute(text(asked)))
    assert "INDEX" in plan
    assert "TEMP B-TREE" not in plan


def test_a_request_that_comes_again_is_one_letter_with_two_attempts(
    records: Records, archive: Archive
) -> None:
    first = _take(records, number=1)
    second = _take(
        records, number=1, id="0199ffff-0000-7000-8000-000000000000", deaths=2, incident_ids=["i2"]
    )
    assert first == second
    by_old, by_new = archive.letter(first), archive.letter("0199ffff-0000-7000-8000-000000000000")
    assert by_old == by_new
    assert by_old is not None
    assert (by_old.deaths, by_old.incident_ids, len(by_old.attempts)) == (2, ("i1", "i2"), 2)
    with records.reading() as connection:
        row = letters.in_state(connection, LetterState.QUARANTINED)[0]
    assert row["rule"] == "0199ffff-0000-7000-8000-000000000000"


def test_a_retry_that_came_back_without_its_case_keeps_it(records: Records, archive: Archive) -> None:
    first = _take(records, number=1)
    _take(records, number=1, case=None, account_ids=[], command_id="")
    found = archive.letter(first)
    assert found is not None
    assert found.payload is not None
    assert (found.command_id, found.account_ids) == ("c1", ("assets:cash", "expenses:food"))


def test_of_two_who_want_one_letter_one_gets_it(records: Records) -> None:
    letter = _take(records, number=1)
    with records.writing() as connection:
        first = letters.move(connection, letter, Trigger.RETRY, NOW)
        second = letters.move(connection, letter, Trigger.RETRY, NOW)
    assert not isinstance(first, Refusal)
    assert second == Refusal("letter_busy", {"state": "RETRYING"})


def test_a_message_is_taken_in_once_whoever_dies_between(
    records: Records, archive: Archive, tmp_path: Path
) -> None:
    taken = intake.Intake(records, tmp_path / "spool", tmp_path / "incidents")
    path = spool.write(taken.spool, "letter", slip())
    assert isinstance(path, Path)
    data = path.read_bytes()
    assert taken.take_spool() == 1
    path.write_bytes(data)  # as if its reader had died before it removed it
    taken.take_spool()
    found = archive.letter(slip()["id"])
    assert found is not None
    assert len(found.attempts) == 1
    assert not path.exists()


def test_what_says_nothing_is_put_into_a_corner_that_does_not_grow(
    records: Records, archive: Archive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(intake, "UNREADABLE_MAX", 3)
    taken = intake.Intake(records, tmp_path / "spool", tmp_path / "incidents")
    taken.spool.mkdir()
    for number in range(5):
        (taken.spool / f"0000000{number}-0000-7000-8000-000000000000.json").write_text("{")
    spool.write(taken.spool, "rumour", {})
    spool.write(taken.spool, "letter", {"id": "../x"})
    spool.write(taken.spool, "act", {"who": "cli", "verb": "restart", "what": "core", "reason": "<b>"})
    taken.take_spool()
    assert [one.name for one in taken.spool.iterdir()] == ["unreadable"]
    assert len(list((taken.spool / "unreadable").iterdir())) == 3
    acts = archive.audit(50).items
    assert [act.verb for act in acts].count("unreadable") == 7
    assert Act(acts[0].at, "cli", "restart", "core", "<b>", "done") in acts


def test_a_message_that_can_not_be_opened_now_is_taken_in_later(
    records: Records, archive: Archive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = intake.Intake(records, tmp_path / "spool", tmp_path / "incidents")
    spool.write(taken.spool, "letter", slip())

    def no_descriptor(*_: object) -> int:
        raise OSError(errno.EMFILE, "Too many open files")

    with monkeypatch.context() as patched:
        patched.setattr(os, "open", no_descriptor)
        assert taken.take_spool() == 0
    assert archive.audit(5).total == 0
    assert taken.take_spool() == 1
    assert archive.letter(slip()["id"]) is not None


def test_what_can_be_neither_read_nor_moved_stays_and_is_told_once(
    records: Records, archive: Archive, tmp_path: Path
) -> None:
    taken = intake.Intake(records, tmp_path / "spool", tmp_path / "incidents")
    taken.spool.mkdir()
    (taken.spool / "00000000-0000-7000-8000-000000000000.json").write_text("{")
    (taken.spool / "unreadable").write_text("a file is in the way")
    for _ in range(3):
        taken.take_spool()
    assert [act.verb for act in archive.audit(5).items] == ["unreadable"]
    (taken.spool / "unreadable").unlink()
    taken.take_spool()
    assert [one.name for one in taken.spool.iterdir()] == ["unreadable"]
    assert archive.audit(5).total == 1


def test_a_drill_is_in_the_log_with_its_end(records: Records, archive: Archive, tmp_path: Path) -> None:
    taken = intake.Intake(records, tmp_path / "spool", tmp_path / "incidents")
    spool.write(taken.spool, "drill", {"fault": "crash", "ok": True, "outage_ms": 80, "scheduled": True})
    spool.write(taken.spool, "drill", {"fault": "freeze", "ok": False})
    taken.take_spool()
    told = [(act.who, act.verb, act.what, act.outcome) for act in archive.audit(5).items]
    assert told == [
        ("sentinel", "drill-ended", "freeze", "failed"),
        ("schedule", "drill-ended", "crash", "passed, 80 ms"),
    ]


def test_a_letter_that_comes_back_for_another_account_is_found_by_it(
    records: Records, archive: Archive
) -> None:
    first = _take(records, number=1)
    _take(records, number=1, account_ids=["assets:bank"])
    for account in ("assets:bank", "assets:cash"):
        assert [one.id for one in archive.letters(Filter(account=account), 5).items] == [first]


def test_a_discard_stays_to_be_seen_however_old_it_is(records: Records, archive: Archive) -> None:
    discarded, resolved = (_take(records, number=number) for number in (1, 2))
    with records.writing() as connection:
        for letter, trigger in ((discarded, Trigger.DISCARD), (resolved, Trigger.CONFIRMED)):
            letters.move(connection, letter, trigger, "2020-01-01T00:00:00.000Z")
        assert log.forget_old(connection, datetime(2026, 11, 23, tzinfo=UTC)) == 1
    assert [one.id for one in archive.letters(Filter(), 5).items] == [discarded]


@pytest.mark.parametrize(
    "files",
    [
        {},
        {"manifest.json": b"{", "incident.json": b"["},
        {"manifest.json": b'{"version": 99}', "incident.json": b"{}"},
        {"incident.json": b'{"diagnosis": "<script>alert(1)</script>", "summary": "\\u001b[2J"}'},
        {"incident.json": b"x" * 1_000_000, "stacks.txt": b"\x1b]0;x\x07" * 1_000},
        {"manifest.json": b'{"version":1,"incident":"../..","files":{"a":{"sha256":"0","size_bytes":3}}}'},
    ],
)
def test_a_folder_that_can_not_be_understood_is_an_incident_all_the_same(
    records: Records, archive: Archive, tmp_path: Path, files: dict[str, bytes]
) -> None:
    folder = tmp_path / "incidents" / "0199aaaa-0000-7000-8000-000000000000"
    folder.mkdir(parents=True)
    for name, data in files.items():
        (folder / name).write_bytes(data)
    taken = intake.Intake(records, tmp_path / "spool", tmp_path / "incidents")
    assert taken.take_incidents() == 1
    assert taken.take_incidents() == 0
    found = archive.incident(folder.name)
    assert found is not None
    assert found.opened_at.startswith("20")
    assert set(found.summary) == {"ko", "en"}


def test_old_stories_go_and_letters_that_wait_never(
    records: Records, archive: Archive, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log, "INCIDENTS_MAX", 10)
    monkeypatch.setattr(log, "SETTLED_MAX", 2)
    _put(records, *(_story(number) for number in range(15)))
    ids = [_take(records, number=number, quarantined_at="2020-01-01T00:00:00.000Z") for number in range(1, 7)]
    with records.writing() as connection:
        for letter in ids[:4]:
            letters.move(connection, letter, Trigger.DISCARD, NOW, discarded_because="x")
        assert log.forget_old(connection, datetime(2026, 11, 23, tzinfo=UTC)) == 7
        assert log.forget_old(connection, datetime(2026, 11, 23, tzinfo=UTC)) == 0
    assert archive.incidents(Filter(), 50).total == 10
    found = archive.group("f1")
    assert found is not None
    assert found.count == 10
    left = archive.letters(Filter(), 50)
    assert left.total == 4
    assert archive.letters(Filter(state="QUARANTINED"), 50).total == 2


def test_what_a_person_decided_outlives_a_new_reading(records: Records, archive: Archive) -> None:
    _put(records, _story(1))
    [proposal] = archive.proposals("i00001")
    with records.writing() as connection:
        log.put_decision(connection, proposal.id, state="accepted", rule_id="r1", owner="kim")
    _put(records, _story(1, outage_ms=5.0))
    assert [(one.state, one.owner) for one in archive.proposals("i00001")] == [("accepted", "kim")]


@pytest.mark.parametrize("data", ["{", "[]", '{"hits": 3}', '{"hits": {"r1": 3, "r2": {"count": "x"}}}'])
def test_hits_that_can_not_be_read_are_none(
    records: Records, archive: Archive, tmp_path: Path, data: str
) -> None:
    (tmp_path / "rule_hits.json").write_text(data)
    _put(records, _story(1))
    assert [one.hits for one in archive.proposals()] == [0]


def test_a_damaged_archive_is_put_aside_and_a_newer_one_left_alone(tmp_path: Path) -> None:
    (tmp_path / "a.db").write_bytes(b"no database at all" * 100)
    opened = open_records(tmp_path / "a.db")
    assert isinstance(opened, Records)
    assert opened.put_aside is not None
    assert opened.put_aside.read_bytes().startswith(b"no database")
    opened.close()
    with sqlite3.connect(tmp_path / "b.db") as newer:
        newer.execute("PRAGMA user_version = 99")
    newer.close()
    refused = open_records(tmp_path / "b.db")
    assert isinstance(refused, RecordsFailed)
    assert "99" in refused.reason


def test_groups_that_were_put_together_take_in_later_deaths_and_come_apart_again(
    records: Records, archive: Archive
) -> None:
    _put(records, _story(1), _story(2, fingerprint="f2"), _story(3, fingerprint="f3"))
    with records.writing() as connection:
        assert stories.merge(connection, "f1", "f2") is None
        assert stories.merge(connection, "f2", "f3") is None
    _put(records, _story(4), _story(1, outage_ms=5.0))
    merged = archive.group("f3")
    assert merged is not None
    assert (merged.count, merged.merged, merged.newest) == (4, ("f1", "f2"), "i00004")
    assert [group.merged for group in archive.groups(Filter(), 5).items] == [("f1", "f2")]
    with records.writing() as connection:
        assert stories.split(connection, "f3") is None
        assert stories.split(connection, "f3") == Refusal("group_whole", {})
    found = {group.fingerprint: group.count for group in archive.groups(Filter(), 5).items}
    assert found == {"f1": 2, "f2": 1, "f3": 1}
    _put(records, _story(4))  # it is read once more, for its group's name
    named = archive.group("f1")
    assert named is not None
    assert (named.title["en"], named.why) == ("Deaths", ("SIGSEGV",))


def test_an_incident_that_was_taken_out_of_its_group_stays_out(records: Records, archive: Archive) -> None:
    _put(records, _story(1), _story(2))
    with records.writing() as connection:
        assert stories.take_apart(connection, "f1", "nobody") == Refusal("incident_unknown", {})
        assert stories.take_apart(connection, "f1", "i00001") is None
        assert stories.take_apart(connection, "f1", "i00002") == Refusal("group_whole", {})
    _put(records, _story(1, outage_ms=5.0))
    assert {group.fingerprint: group.count for group in archive.groups(Filter(), 5).items} == {
        "f1": 1,
        "apart-i00001": 1,
    }
    with records.writing() as connection:
        assert stories.merge(connection, "apart-i00001", "f1") is None
    back = archive.group("f1")
    assert back is not None
    assert back.count == 2


@pytest.mark.parametrize(("one", "other"), [("f1", "f9"), ("f9", "f1"), ("f9", "f9"), ("f1", "f1")])
def test_only_two_groups_that_are_there_are_put_together(records: Records, one: str, other: str) -> None:
    _put(records, _story(1))
    with records.writing() as connection:
        assert isinstance(stories.merge(connection, one, other), Refusal)


def test_a_note_stays_when_its_incident_is_read_again(records: Records, archive: Archive) -> None:
    _put(records, _story(1))
    with records.writing() as connection:
        assert stories.put_note(connection, "i00001", "<b>the cat</b>")
        assert not stories.put_note(connection, "nobody", "x")
    _put(records, _story(1, outage_ms=5.0))
    found = archive.incident("i00001")
    assert found is not None
    assert (found.note, found.outage_ms) == ("<b>the cat</b>", 5.0)


def test_an_archive_of_the_first_version_is_brought_forward(tmp_path: Path) -> None:
    path = tmp_path / "hardcore.db"
    opened = open_records(path)
    assert isinstance(opened, Records)
    _put(opened, _story(1))
    with opened.writing() as connection:
        for table, column in (
            ("incidents", "base"), ("incidents", "apart"), ("incidents", "note"),
            ("proposals", "unsure"), ("letters", "corrected_by"), ("letters", "correction"),
            ("letters", "was_held"),
        ):  # fmt: skip
            connection.exec_driver_sql(f"ALTER TABLE {table} DROP COLUMN {column}")
        connection.exec_driver_sql("DROP TABLE merges")
        connection.exec_driver_sql("PRAGMA user_version = 1")
    opened.close()
    again = open_records(path)
    assert isinstance(again, Records)
    _put(again, _story(1, outage_ms=5.0), _story(2))
    found = Archive(again, tmp_path / "hits").group("f1")
    again.close()
    assert found is not None
    assert found.count == 2


def _rules(tmp_path: Path, *rules: dict[str, Any]) -> Path:
    path = tmp_path / "quarantine.json"
    path.write_text(json.dumps({"version": 1, "serial": 3, "rules": rules}))
    return path


def test_what_the_guard_refuses_is_on_the_list_also_in_an_archive_that_was_lost(
    records: Records, archive: Archive, tmp_path: Path
) -> None:
    known = _take(records, number=1)
    rule = {"type": "letter", "digest": None, "fingerprint": "b" * 64, "account_ids": ["assets:cash"]}
    path = _rules(
        tmp_path,
        {**rule, "id": "l1", "name": f"{1:032x}", "reason": "CRASHED_CORE"},  # of a letter that is here
        {**rule, "id": "l2", "name": f"{2:032x}", "reason": "UNPROVEN"},
        {**rule, "id": "l3", "name": f"{3:032x}", "reason": "HUNG_CORE", "unsent": {"id": "l3"}},
        {"id": "l4", "type": "parked", "seq": 812, "account_ids": ["assets:cash"]},
        {"id": "l5", "type": "limit", "kind": "transaction.post", "per_minute": 3},
        {"id": "../l6", "type": "letter", "name": 3},
    )
    taken = intake.Intake(records, tmp_path / "spool", tmp_path / "incidents", path)
    for _ in range(2):
        taken.begin()
    found = {one.id: one for one in archive.letters(Filter(), 9).items}
    assert set(found) == {known, "l2", "l4"}
    assert (found["l2"].state, found["l4"].seq) == (LetterState.HELD, 812)
    assert [one.id for one in archive.letters(Filter(account="assets:cash"), 9).items if one.id == "l4"]
    assert [act.verb for act in archive.audit(9).items] == ["found"]


def test_a_proposal_that_the_guard_enforces_is_an_accepted_one(
    records: Records, archive: Archive, tmp_path: Path
) -> None:
    _put(records, _story(1), _story(2))
    enforced = archive.proposals("i00001")[0].id
    path = _rules(tmp_path, {"id": f"proposal-{enforced}", "type": "fingerprint", "fingerprint": "f" * 64})
    found_rules.read(path).take_proposals(records)
    assert {one.incident: str(one.state) for one in archive.proposals()} == {
        "i00001": "accepted",
        "i00002": "open",
    }


@pytest.mark.parametrize(
    "text", ["", "[]", "{", '{"version": 9, "rules": [1]}', '{"version": 1, "rules": 3}']
)
def test_rules_that_can_not_be_read_make_no_letters(records: Records, tmp_path: Path, text: str) -> None:
    (tmp_path / "quarantine.json").write_text(text)
    assert found_rules.read(tmp_path / "quarantine.json").take_letters(records) == 0
