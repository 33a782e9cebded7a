"""The file of what is set aside: one value after the other, and rules of people judged whole."""

import json
from pathlib import Path
from typing import Any

import pytest

from hardcore import quarantine_file
from hardcore.host.folders import Folders
from hardcore.model.trials import Letter, Reason, SuspectNote
from hardcore.quarantine_file import Aside

HEX = "ab" * 32


@pytest.fixture
def folders(tmp_path: Path) -> Folders:
    made = Folders(tmp_path, tmp_path / "run")
    made.state.mkdir()
    return made


def letter(number: int, **more: Any) -> Letter:
    return Letter(f"letter-{number}", "c" * 32, Reason.CRASHED_CORE, False, ("incident",), 1, **more)


def test_what_was_written_is_read_again_but_for_who_is_suspect(folders: Folders) -> None:
    aside = quarantine_file.set_aside(Aside(), letter(1, digest=HEX), {"id": "letter-1"})
    aside = quarantine_file.with_suspects(aside, (SuspectNote("d" * 32, ("a",)),))
    aside = quarantine_file.with_source(aside, "browser:1", "2026-11-22T14:00:00Z", "2026-11-22T13:00:00Z")
    quarantine_file.write(folders, aside)
    found = quarantine_file.read(folders)
    assert (found.serial, found.rules, found.sources) == (3, aside.rules, aside.sources)
    assert found.suspects == ()
    assert json.loads(folders.quarantine.read_text())["suspects"] == [
        {"name": "d" * 32, "account_ids": ["a"]}
    ]


def test_an_event_is_parked_and_a_request_is_refused() -> None:
    aside = quarantine_file.set_aside(Aside(), letter(1, seq=812, account_ids=("assets:cash",)), {})
    assert {k: aside.rules[0][k] for k in ("type", "seq", "account_ids")} == {
        "type": "parked",
        "seq": 812,
        "account_ids": ["assets:cash"],
    }


def test_a_letter_bears_its_message_until_it_is_written_and_nobody_else_sees_it() -> None:
    aside = quarantine_file.set_aside(Aside(), letter(1), {"id": "letter-1"})
    assert aside.unsent
    assert quarantine_file.UNSENT not in quarantine_file.shown(aside)["rules"][0]
    after = quarantine_file.sent(aside, "letter-1")
    assert (after.unsent, after.serial) == ((), aside.serial), "nobody has to read it anew"


def test_of_too_many_letters_the_oldest_goes_and_a_persons_rule_never() -> None:
    aside = quarantine_file.with_rule(Aside(), {"id": "mine", "type": "limit"})
    for number in range(quarantine_file.RULES_MAX):
        aside = quarantine_file.set_aside(aside, letter(number), {})
    ids = [rule["id"] for rule in aside.rules]
    assert (len(ids), ids[0], ids[1]) == (quarantine_file.RULES_MAX, "mine", "letter-1")


def test_a_source_whose_time_is_over_goes() -> None:
    aside = quarantine_file.with_source(Aside(), "a", "2026-11-22T14:00:00Z", "2026-11-22T13:00:00Z")
    aside = quarantine_file.with_source(aside, "b", "2026-11-22T15:00:00Z", "2026-11-22T14:30:00Z")
    assert aside.sources == (("b", "2026-11-22T15:00:00Z"),)


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"version": 1, "rules": [{"id": 5}, {}, 7], "serial": "x"}']
)
def test_a_file_that_can_not_be_read_sets_nothing_aside(folders: Folders, text: str) -> None:
    folders.quarantine.write_text(text)
    assert quarantine_file.read(folders) == Aside()


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"version": 1, "serial": 5, "rules": [{"id": "mi'])
def test_a_damaged_file_is_kept_and_said_and_no_serial_comes_a_second_time(
    folders: Folders, text: str
) -> None:
    folders.quarantine.write_text(text)
    found, fault = quarantine_file.take_in(folders)
    assert found == Aside(found.serial)
    assert found.serial > 1_000_000_000
    assert quarantine_file.DAMAGED in fault
    assert (folders.state / quarantine_file.DAMAGED).read_text() == text
    assert quarantine_file.take_in(folders) == (Aside(), ""), "where there is none, nothing is wrong"


def test_what_was_written_whole_is_taken_in_with_what_was_released(folders: Folders) -> None:
    aside = quarantine_file.set_aside(Aside(), letter(1, digest=HEX), {"id": "letter-1"})
    aside = quarantine_file.without_rule(quarantine_file.set_aside(aside, letter(2), {}), "letter-2")
    quarantine_file.write(folders, aside)
    assert quarantine_file.take_in(folders) == (aside, "")
    assert aside.released == ("letter-2",)
    assert quarantine_file.with_rule(aside, {"id": "letter-2"}).released == ()
    assert "released" not in quarantine_file.shown(aside)


def test_no_file_is_written_that_nobody_could_read(folders: Folders) -> None:
    accounts = tuple(f"{number:0200d}" for number in range(16))
    many = tuple(SuspectNote(f"{number:032x}", accounts) for number in range(quarantine_file.SUSPECTS_MAX))
    quarantine_file.write(folders, quarantine_file.with_suspects(Aside(), many))
    told = json.loads(folders.quarantine.read_bytes()[: quarantine_file.FILE_BYTES_MAX])
    assert [one["name"] for one in told["suspects"]] == [one.name for one in many]
    huge = quarantine_file.with_rule(Aside(), {"id": "x", "more": "x" * quarantine_file.FILE_BYTES_MAX})
    with pytest.raises(OSError, match="too long"):
        quarantine_file.write(folders, huge)


@pytest.mark.parametrize(
    "wish",
    [
        {"type": "fingerprint", "fingerprint": HEX},
        {"type": "limit", "kind": "transaction.post", "per_minute": 30},
        {"type": "limit", "kind": "transaction.post", "body_bytes_max": 0},
        {"type": "deadline", "kind": "transaction.post", "limit_ms": 2000},
        {"type": "letter", "id": "l", "name": "c" * 32, "reason": "UNPROVEN", "account_ids": []},
        {"type": "parked", "id": "l", "seq": 5, "account_ids": ["a"]},
    ],
)
def test_a_rule_that_makes_sense_is_taken_and_nothing_beside_it(wish: dict[str, Any]) -> None:
    rule = quarantine_file.judge({**wish, "more": 1}, "new")
    assert isinstance(rule, dict)
    assert rule["id"] == wish.get("id", "new")
    assert "more" not in rule


@pytest.mark.parametrize(
    "wish",
    [
        None,
        [],
        {},
        {"type": "letter"},
        {"type": "fingerprint", "fingerprint": "AB" * 32},
        {"type": "limit", "kind": "transaction.post"},
        {"type": "limit", "kind": "", "per_minute": 1},
        {"type": "limit", "kind": "x", "per_minute": True},
        {"type": "limit", "kind": "x", "per_minute": -1},
        {"type": "limit", "kind": "x", "body_bytes_max": 1 << 40},
        {"type": "deadline", "kind": "x", "limit_ms": 0},
        {"type": "deadline", "kind": "\x1b[2J", "limit_ms": 5},
        {"type": "letter", "id": "l", "name": "c" * 32, "reason": "BECAUSE", "account_ids": []},
        {"type": "letter", "id": "a\r\nb", "name": "c" * 32, "reason": "UNPROVEN", "account_ids": []},
        {"type": "parked", "id": "l", "seq": 0, "account_ids": []},
    ],
)
def test_a_rule_that_makes_none_is_refused_in_a_sentence(wish: object) -> None:
    said = quarantine_file.judge(wish, "new")
    assert isinstance(said, str)
    assert said.endswith(".")


def test_each_of_several_drills_is_disarmed_for_itself(folders: Folders) -> None:
    names = [f"{number:032x}" for number in range(quarantine_file.ARMED_MAX + 1)]
    for name in names:
        quarantine_file.arm(folders, name)
    assert quarantine_file.armed_names(folders) == names[1:], "the oldest is over"
    for name in names[2:]:
        assert quarantine_file.disarm(folders, name)
    assert quarantine_file.armed_names(folders) == [names[1]]
    quarantine_file.arm(folders, "a" * 32, "write")
    assert quarantine_file.armed_names(folders) == ["a" * 32], "it strikes at another moment"


def test_a_drill_is_disarmed_by_its_own_name_alone(folders: Folders) -> None:
    quarantine_file.arm(folders, "a" * 32)
    assert not quarantine_file.disarm(folders, "b" * 32)
    assert quarantine_file.disarm(folders, "a" * 32)
    assert not folders.armed.exists()


def test_a_rule_that_is_asked_for_under_a_number_has_that_number() -> None:
    wish = {"type": "fingerprint", "fingerprint": HEX}
    named = quarantine_file.judge({**wish, "id": "proposal-1"}, "new")
    assert named == {**wish, "id": "proposal-1"}
    assert quarantine_file.judge({**wish, "id": "two words"}, "new") == {**wish, "id": "new"}
