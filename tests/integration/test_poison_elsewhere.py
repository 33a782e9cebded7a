"""Poison in other places than one request: in many at once, in a row of a file, after its answer, in the log itself."""

import json
import time
from collections.abc import Iterator
from typing import Any

import pytest

from hardcore import quarantine_file
from tests import stores
from tests.integration.house import WITH_SPARE, House, transaction
from tests.integration.poisoning import Load, house_story, letter_of, name_of, rules
from tests.integration.test_imports import commit, statement, uploaded
from tests.waiting import until

ROWS = 200
POISONED_ROW = 120
POISONS = 10  # as many as one source may have convicted in a minute
INNOCENTS = 6
ENDS_S = 60.0


@pytest.fixture(scope="module")
def shared_house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    house = House(tmp_path_factory.mktemp("poison") / "data", WITH_SPARE)
    try:
        house.up().open_accounts()
        yield house
    finally:
        house.end()


def arm(house: House, at: str, *keys: str) -> None:
    """Arm what a test sends by itself; a rule that does nothing has the cores read it."""
    for key in keys:
        quarantine_file.arm(house.folders, name_of(key), at)
    told = house.order("rule-add", rule={"type": "limit", "kind": "nothing", "per_minute": 1})
    assert told["ok"], told


def test_ten_poisons_at_once_cost_one_death_and_refuse_nobody_else(house: House) -> None:
    house.spared()
    before = len(house.incidents())
    poisons = [f"poison-{number}" for number in range(POISONS)]
    innocents = [f"beside-{number}" for number in range(INNOCENTS)]
    arm(house, "decide", *poisons)
    load = Load(house, "nobody", customers=0)
    try:
        with stores.locked(house.data) as holder:  # so that the core has all of them when it dies
            sent = {key: load.send(key, key) for key in [*poisons[:5], *innocents, *poisons[5:]]}
            until(lambda: house.status()["core"]["in_flight"] == len(sent), "the core to have them all")
            holder.execute("ROLLBACK")
        letters = {letter_of(house, key) for key in poisons}
        answers = {key: answer.result() for key, answer in sent.items()}
    finally:
        load.stop()
    assert len(letters) == POISONS
    assert {answers[key].status for key in poisons} == {422}, answers
    assert {answers[key].status for key in innocents} == {201}, answers
    assert [death["diagnosis"] for death in house.closed(before + 1)["deaths"]] == ["CRASHED"]
    assert len(house.incidents()) == before + 1
    assert sorted(one for one in house.booked() if one in sent) == innocents
    until(lambda: not house.folders.armed.exists(), "each to be disarmed by its verdict")
    told = json.loads((house.folders.incidents / house.incidents()[0]["id"] / "incident.json").read_text())
    ran = {name: len(str(told[name])) for name in ("build", "policy_sha256")}
    assert ran == {"build": 16, "policy_sha256": 64}, "what changed since can be told by that"


def test_a_poison_row_of_a_file_costs_that_row_and_one_death(house: House) -> None:
    house.spared()
    before = len(house.incidents())
    import_id = uploaded(house, statement(ROWS, "row"))
    key = f"{import_id}:{POISONED_ROW}"
    arm(house, "decide", key)
    assert commit(house, import_id).status == 202
    letter = letter_of(house, key)

    def over() -> dict[str, Any] | None:
        answer = house.ask("GET", f"/api/ledger/imports/{import_id}")
        return answer.body if answer.status == 200 and answer.body["state"] == "done" else None

    told = until(over, "the import to end", ENDS_S)
    assert told is not None
    assert (told["rows"]["new"], told["rows"]["refused"]) == (ROWS - 1, 1), told
    assert [death["diagnosis"] for death in house.closed(before + 1)["deaths"]] == ["CRASHED"]
    (rule,) = (rule for rule in rules(house) if rule["id"] == letter)
    assert rule["name"] == name_of(key)


def test_a_poison_that_works_after_its_answer_convicts_nobody_and_loses_nothing(house: House) -> None:
    house.spared()
    before, ruled = len(house.incidents()), len([r for r in rules(house) if r["type"] == "letter"])
    arm(house, "later", "delayed")
    assert house.book("delayed").status == 201
    story = house.closed(before + 1)
    assert [death["diagnosis"] for death in story["deaths"]] == ["CRASHED"]
    house.running()
    assert house.booked().count("delayed") == 1
    assert house.book("delayed").status == 201, "it is answered as it was, and not run again"
    assert len([r for r in rules(house) if r["type"] == "letter"]) == ruled
    house.folders.armed.unlink(missing_ok=True)


def test_an_errand_of_the_scheduler_that_kills_is_set_aside_and_the_others_are_done(house: House) -> None:
    house.running()
    before = len(house.incidents())
    held = [
        house.ask(
            "POST", "/api/ledger/transactions", {**transaction(name), "state": "pending", "timeout_s": 1}
        )
        for name in ("kills", "harmless")
    ]
    run_out_s = time.time() + 1.5
    poison, other = (f"/api/ledger/transactions/{one.body['id']}" for one in held)
    house.cli("down")
    key = f"pending-expiry:{held[0].body['id']}"
    quarantine_file.arm(house.folders, name_of(key), "decide")
    until(lambda: time.time() > run_out_s, "both to have run out: the first round comes with the start")
    house.up_unproven()
    letter = letter_of(house, key)
    until(lambda: house.ask("GET", other).body.get("state") == "expired", "the other one to be freed", ENDS_S)
    house.running()
    assert house.ask("GET", poison).body["state"] == "pending"
    assert house.book("after-the-errand").status == 201
    fresh = house.incidents()[: len(house.incidents()) - before]
    assert sum(len(house_story(house, item["id"])["deaths"]) for item in fresh) <= 2
    assert letter in json.dumps(house.cli("--json", "dlq", "list").told)


def test_an_event_that_kills_whoever_rebuilds_from_it_is_parked_after_two_starts_at_most(
    house: House,
) -> None:
    house.spared()
    before = len(house.incidents())
    seq = house.book("in-the-log").body["seq"]
    house.cli("down")
    quarantine_file.arm(house.folders, "f" * 32, "log")
    text = house.folders.armed.read_text().replace('"seq": null', f'"seq": {seq}')
    house.folders.armed.write_text(text)
    house.up_unproven()

    def parked() -> bool:
        return any(rule["type"] == "parked" and rule["seq"] == seq for rule in rules(house))

    until(parked, "the event to be parked", ENDS_S)
    house.running()
    fresh = house.incidents()[: len(house.incidents()) - before]
    assert sum(len(house_story(house, item["id"])["deaths"]) for item in fresh) <= 2
    assert house.ask("GET", "/api/ledger/transactions?limit=1").status == 200
