"""A request that kills whoever carries it out, in a real house: it costs one death, and nobody else anything."""

import signal
from collections.abc import Iterator

import pytest

from hardcore import quarantine_file
from tests.integration.house import WITH_SPARE, House, transaction
from tests.integration.poisoning import Load, armed, house_story, letter_of, name_of, rules
from tests.waiting import until

KILLS = 6


@pytest.fixture(scope="module")
def shared_house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    house = House(tmp_path_factory.mktemp("poison") / "data", WITH_SPARE)
    try:
        house.up().open_accounts()
        yield house
    finally:
        house.end()


def test_one_poison_among_ten_innocents_under_load_costs_one_death_and_refuses_nobody_else(
    house: House,
) -> None:
    house.spared()
    before = len(house.incidents())
    load = Load(house, "load")
    try:
        key = armed(house)
        innocents = [load.send(f"innocent-{number}", f"innocent-{number}") for number in range(5)]
        poison = load.send(key, "the poison")
        innocents += [load.send(f"innocent-{number}", f"innocent-{number}") for number in range(5, 10)]
        letter = letter_of(house, key)
        refused = poison.result()
        assert [each.result().status for each in innocents] == [201] * 10
    finally:
        load.stop()
    assert (refused.status, refused.outcome, refused.body["letter"]) == (422, "not_done", letter), refused
    story = house.closed(before + 1)
    assert [death["diagnosis"] for death in story["deaths"]] == ["CRASHED"]
    assert load.others == []
    booked = house.booked()
    assert len(booked) == len(set(booked)), "nothing twice"
    assert {*load.booked, *(f"innocent-{number}" for number in range(10))} <= set(booked)
    assert "the poison" not in booked

    under_its_key = house.ask("POST", "/api/ledger/transactions", transaction("the poison"), key=key)
    under_another = house.ask("POST", "/api/ledger/transactions", transaction("the poison"), key="another")
    assert [each.status for each in (under_its_key, under_another)] == [422, 422]
    assert {each.body["letter"] for each in (under_its_key, under_another)} == {letter}
    assert len(house.incidents()) == before + 1, "it is refused, and kills nobody"


def test_what_came_of_a_trial_is_told_by_its_incident_and_lies_in_the_spool_or_has_been_taken_in(
    house: House,
) -> None:
    incident = house.incidents()[0]["id"]
    told = until(lambda: house_story(house, incident)["trials"], "the trials in the incident")
    assert [trial["ordeal"] for trial in told if trial["letter"]] == ["died"]
    assert {trial["ordeal"] for trial in told if not trial["letter"]} <= {"survived", "committed"}
    assert not quarantine_file.read(house.folders).unsent
    until(lambda: not list(house.folders.cases.iterdir()), "the case to be filed away")


def test_a_rule_that_a_person_takes_away_lets_its_request_run_once(house: House) -> None:
    (rule,) = (rule for rule in rules(house) if rule["type"] == "letter")
    taken = house.order("rule-remove", id=rule["id"], reason="a test")
    assert (taken["ok"], taken["changed"]) == (True, True), taken
    assert house.order("rule-remove", id=rule["id"])["changed"] is False
    answer = house.ask("POST", "/api/ledger/transactions", transaction("the poison"), key="at-last")
    assert answer.status == 201, answer
    assert house.order("rule-add", rule={"type": "limit", "kind": "x"})["code"] == "bad-rule"


def test_kills_from_outside_convict_nobody(house: House) -> None:
    before = rules(house)
    load = Load(house, "killed")
    try:
        for _ in range(KILLS):
            load.go_on()
            victim = house.hit("core")
            until(lambda: victim.gone, "the core to be gone")  # noqa: B023  # it is waited for here
        house.running()
    finally:
        load.stop()
    assert rules(house) == before
    booked = house.booked()
    # Two deaths in a row may hit one request: then it is looked up and not run a third time, and its client is told so.
    assert {(answer.status, answer.outcome) for _, answer in load.others} <= {(503, "not_done")}
    assert not {key for key, _ in load.others} & set(booked)
    assert len(booked) == len(set(booked))
    assert set(load.booked) <= set(booked)


@pytest.mark.parametrize("who", ["court", "sentinel", "gateway"])
def test_a_trial_whose_parties_die_in_the_middle_comes_to_its_verdict_all_the_same(
    house: House, who: str
) -> None:
    house.spared()
    load = Load(house, f"trial-{who}", customers=1)
    try:
        key = armed(house)
        load.send(key, f"the poison of the {who}")
        court = until(lambda: _court(house), "a court")
        assert court is not None
        house.hold_pid(court if who == "court" else house.status()[who]["pid"]).hit(signal.SIGKILL)
        letter = letter_of(house, key)
    finally:
        load.stop()
    house.running()
    assert [rule["id"] for rule in rules(house) if rule.get("name") == name_of(key)] == [letter]
    again = house.ask("POST", "/api/ledger/transactions", transaction(f"the poison of the {who}"), key=key)
    assert (again.status, again.body["letter"]) == (422, letter)
    until(lambda: _court(house) is None, "the court to be gone")
    booked = house.booked()
    assert set(load.booked) <= set(booked)
    assert len(booked) == len(set(booked))


def _court(house: House) -> int | None:
    found = house.processes().items()
    return next((pid for pid, words in found if "-m core try" in words and "nice" not in words), None)
