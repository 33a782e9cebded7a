import json
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from postmortem import incident
from postmortem.incident import Money
from tests.unit.postmortem import story

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=20,
)
#: A loaded machine is no fault of the reader's.
UNTIMED = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])


def test_what_the_guard_wrote_is_what_is_read() -> None:
    read = incident.from_facts(story.ID, json.loads(json.dumps(story.facts())))
    assert (read.outcome, read.diagnosis, read.grade) == ("recovered", "KILLED_FROM_OUTSIDE", "certain")
    assert (read.detected_ms, read.outage_ms) == (0.8, 912.3)
    assert [step.step for step in read.timeline] == ["fault", "detected", "serving"]
    assert read.exit == incident.Exit(signal=9)
    assert read.requests[0].outcome == "replayed"
    assert (read.epoch, read.next_epoch) == (7, 8)


@UNTIMED
@given(st.dictionaries(st.sampled_from(sorted(story.facts())), JSON))
def test_no_value_in_any_place_is_a_surprise(broken: dict[str, Any]) -> None:
    read = incident.from_facts(story.ID, story.facts(**broken))
    assert read.outcome in incident.OUTCOMES
    assert read.grade in incident.GRADES
    incident.money(read)
    incident.at_work(read)


@UNTIMED
@given(JSON)
def test_facts_may_be_anything_at_all(raw: object) -> None:
    assert incident.from_facts(story.ID, raw).id == story.ID
    assert incident.still_open(story.ID, None, raw).outcome == "open"


@pytest.mark.parametrize(
    ("proof", "expected"),
    [
        ({"kind": "witness", "tail": 9, "seq": 40, "witness_seq": 40}, Money(0, 0, verified=True)),
        ({"kind": "witness", "tail": 9, "seq": 41, "witness_seq": 40}, Money(0, 0, verified=True)),
        ({"kind": "chain", "tail": 1000, "seq": 40, "witness_seq": None}, Money(None, None, verified=True)),
        ({"kind": "chain", "tail": 1000, "seq": 40, "witness_seq": 39}, Money(None, None, verified=True)),
        ({"kind": "witness", "tail": 9, "seq": 39, "witness_seq": 40}, Money(None, None, verified=True)),
        ({"kind": "witness", "tail": 9, "seq": 40, "witness_seq": None}, Money(None, None, verified=True)),
        ({"kind": "witness", "tail": 9, "seq": None, "witness_seq": 40}, Money(None, None, verified=False)),
        ({}, Money(None, None, verified=False)),
        (None, Money(None, None, verified=False)),
    ],
)
def test_money_says_only_what_a_recorded_proof_says(proof: object, expected: Money) -> None:
    assert incident.money(incident.from_facts(story.ID, story.facts(proof=proof))) == expected


@pytest.mark.parametrize(
    ("audit", "expected"),
    [
        ({"ok": True, "seq": 40, "fault": None}, Money(0, 0, verified=True)),
        ({"ok": False, "seq": None, "fault": "event 5 is odd"}, Money(None, None, verified=False)),
        ({"seq": "forty"}, Money(None, None, verified=False)),
        (None, Money(0, 0, verified=True)),
    ],
)
def test_nothing_is_claimed_of_the_money_once_the_whole_ledger_was_found_unsound(
    audit: object, expected: Money
) -> None:
    assert incident.money(incident.from_facts(story.ID, story.facts(audit=audit))) == expected


def test_commands_at_work_are_named_before_those_that_waited() -> None:
    read = incident.from_facts(story.ID, story.facts())
    assert [one.command_id for one in incident.at_work(read)] == ["cmd-1", "cmd-2"]


def test_an_incident_without_facts_is_open_and_knows_its_slots() -> None:
    page = {"pid": 5, "beats": {"epoch": 3}, "in_flight": story.facts()["in_flight"]}
    read = incident.still_open(story.ID, "2026-11-21T14:08:15Z", page)
    assert (read.outcome, read.pid, read.epoch, len(read.in_flight)) == ("open", 5, 3, 2)
