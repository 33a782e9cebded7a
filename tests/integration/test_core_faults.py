"""The core dies or hangs, and comes back with proof: one fault after another on one running house."""

import contextlib
import http.client
import json
import signal

import pytest

from postmortem import bundle
from postmortem import cli as incidents_cli
from tests.integration.clients import assert_exactly_once, at_work, in_ledger
from tests.integration.house import House, whole
from tests.waiting import until

STEPS_OF_A_KILL = ["fault", "detected", "spawned", "fenced", "ready", "serving", "closed"]


def steps(story: dict[str, object]) -> list[str]:
    timeline = story["timeline"]
    assert isinstance(timeline, list)
    offsets = [line["offset_ms"] for line in timeline]
    assert offsets == sorted(offsets), timeline
    return [line["step"] for line in timeline]


def in_order(wanted: list[str], found: list[str]) -> bool:
    rest = iter(found)
    return all(step in rest for step in wanted)


def test_a_keyed_request_sent_into_an_outage_is_answered_201_and_booked_exactly_once(house: House) -> None:
    count = len(house.incidents())
    old = house.hit("core")
    answer = house.book("into-the-outage")
    assert answer.status == 201, answer
    assert old.gone
    again = house.book("into-the-outage")
    assert again.headers.get("idempotent-replayed") == "true"
    assert again.body["id"] == answer.body["id"]
    assert in_ledger(house, "into-the-outage") == {"into-the-outage": 1}

    story = house.closed(count + 1)
    assert story["diagnosis"] == "KILLED_FROM_OUTSIDE"
    assert story["grade"] == "certain"
    assert story["outcome"] == "recovered"
    assert in_order(STEPS_OF_A_KILL, steps(story)), steps(story)
    assert {"alerted", "verified"} <= set(steps(story))
    assert 0 <= story["detected_ms"] < 1000
    assert story["outage_ms"] > 0
    told = [r for r in story["requests"] if r["path"] == "/api/ledger/transactions"]
    assert [r["status"] for r in told] == [201], story["requests"]
    assert story["money"]["verified"]


def test_a_frozen_core_is_judged_and_its_evidence_is_taken_before_it_is_killed(house: House) -> None:
    count = len(house.incidents())
    old = house.hit("core", signal.SIGSTOP)
    answer = house.book("into-the-freeze")
    assert answer.status == 201, answer
    assert old.gone
    assert in_ledger(house, "into-the-freeze") == {"into-the-freeze": 1}

    story = whole(house, count + 1)
    assert (story["diagnosis"], story["outcome"]) == ("FROZEN", "recovered")
    wanted = ["fault", "detected", "frozen", "dumped", "killed", "spawned", "fenced", "ready", "serving"]
    assert in_order(wanted, steps(story)), steps(story)
    assert story["evidence_complete"], story
    folder = house.folders.incidents / story["id"]
    assert bundle.verify_bundle(folder) == []
    assert {"stacks.json", "recorder.bin", "recorder.json", "process.json", "manifest.json"} <= {
        path.name for path in folder.iterdir()
    }


def test_a_core_that_committed_nothing_may_die_twice_and_the_ledger_is_still_whole(house: House) -> None:
    for round_number in range(3):
        count = len(house.incidents())
        house.hit("core")
        assert house.closed(count + 1)["outcome"] == "recovered", f"round {round_number}"
    assert house.ask("GET", "/api/ledger/verify").body["ok"]


def test_a_stop_that_heals_at_once_is_no_incident(house: House) -> None:
    before, count = house.status(), len(house.incidents())
    core = house.hold("core")
    core.hit(signal.SIGSTOP)
    house.until(lambda s: s["core"]["heartbeat_age_ms"] >= 150, "the beat to be late")
    core.hit(signal.SIGCONT)
    after = house.until(lambda s: s["core"]["heartbeat_age_ms"] < 100, "the beat to be back")
    after = house.until(lambda s: s["phase"] == "RUNNING", "it to run again")
    assert after["core"]["pid"] == before["core"]["pid"]
    assert after["core"]["epoch"] == before["core"]["epoch"]
    assert len(house.incidents()) == count
    assert house.book("after-the-hiccup").status == 201


@pytest.mark.parametrize(
    ("fault", "diagnosis"),
    [("crash", "CRASHED"), ("exit", "EXITED"), ("freeze", "FROZEN"), ("block", "LOOP_BLOCKED")],
)
def test_a_drill_is_recovered_from_as_expected_and_does_not_count(
    house: House, fault: str, diagnosis: str
) -> None:
    used, pid = house.status()["budget"]["used"], house.status()["core"]["pid"]
    done = house.cli("--json", "drill", fault, "--yes")
    assert done.code == 0, done
    story = done.told["story"]
    assert done.told["ok"]
    assert (story["diagnosis"], story["outcome"], story["drill"]) == (diagnosis, "recovered", fault)
    after = house.running()
    assert after["core"]["pid"] != pid
    assert after["budget"]["used"] <= used
    assert after["last_incident"] == done.told["incident"]


def test_a_drill_is_refused_while_others_are_connected(house: House) -> None:
    pid = house.status()["core"]["pid"]
    other = http.client.HTTPConnection(house.url.removeprefix("http://"), timeout=20)
    with contextlib.closing(other):
        other.request("GET", "/readyz")
        other.getresponse().read()
        house.until(lambda s: s["gateway"]["connections"] == 1, "the connection to be counted")
        refused = house.cli("drill", "crash")
        assert refused.code == 1
        assert "--yes" in refused.err
        assert house.status()["core"]["pid"] == pid


def test_what_was_in_flight_at_a_crash_is_looked_up_and_run_again_only_when_a_trial_has_cleared_it(
    house: House,
) -> None:
    count = len(house.incidents())
    with at_work(house, 6, "frank-crash", patient=False) as clients:
        until(lambda: len(clients.told) > 30, "the load to run")
        for round_number in range(3):
            answer = house.order("drill", fault="crash", yes=True)
            assert answer["ok"], answer
            house.closed(count + 1 + round_number)
            house.running()
    assert_exactly_once(house, clients)
    for told in clients.told:
        assert told.status in {201, 503}, told
        assert told.status == 201 or told.outcome in {"done", "not_done"}, told
    for item in house.incidents()[:3]:
        story = incidents_cli.show_incident(house.folders.incidents, item["id"])
        assert isinstance(story, dict)
        assert story["diagnosis"] == "CRASHED"
        facts = json.loads((house.folders.incidents / item["id"] / "incident.json").read_text())
        suspects = set(facts["suspects"])
        cleared = {trial["name"] for trial in facts["trials"] if not trial["letter"]}
        for request in story["requests"]:
            if request["key_hash"] in suspects - cleared:
                assert request["outcome"] in {"done", "not_done"}, (request, facts["trials"])


def test_no_innocent_is_suspect_after_a_kill_from_outside(house: House) -> None:
    count = len(house.incidents())
    with at_work(house, 4, "innocent") as clients:
        until(lambda: len(clients.told) > 20, "the load to run")
        house.hit("core")
        story = house.closed(count + 1)
    facts = json.loads((house.folders.incidents / story["id"] / "incident.json").read_text())
    assert facts["suspects"] == []
    assert {told.status for told in clients.told} == {201}
    assert_exactly_once(house, clients)


def test_five_kills_under_load_lose_nothing_double_nothing_and_fail_nobody(house: House) -> None:
    with at_work(house, 4, "five-kills") as clients:
        for _ in range(5):
            told = len(clients.told)
            until(lambda: len(clients.told) > told + 20, "answers between two kills")  # noqa: B023  # called at once
            house.hit("core")
            house.running()
    assert {told.status for told in clients.told} == {201}
    assert_exactly_once(house, clients)
    assert house.ask("GET", "/api/ledger/verify").body["ok"]
