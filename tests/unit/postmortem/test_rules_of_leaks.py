"""What a report says of a core that was changed because something ran out."""

import json

from msgspec.structs import replace

from hardcore.model.forecasts import Resource
from hardcore.recovery.flight import CODEC
from hardcore.recovery.foresight import Foresight
from hardcore.sentinel.trends import Track
from postmortem.analyzer import registry
from postmortem.analyzer.proposals import proposals
from postmortem.analyzer.tape import Tape, read_tape
from tests.unit.postmortem.test_rules_of_causes import MIB, case

MINUTE = 60_000_000_000
GROWN = Tape(course=((-600.0, 100 * MIB), (-300.0, 200 * MIB), (0.0, 300 * MIB)))


def _rules(**facts: object) -> dict[str, dict[str, str]]:
    made = case(tape=GROWN, planned=True, **facts)  # type: ignore[arg-type]  # facts of a story
    return {one.rule: dict(one.values) for one in registry.examine(made)}


def test_a_leak_is_told_with_what_it_grew_from_and_to() -> None:
    found = _rules(diagnosis="LEAK")
    assert found["leak"] == {"minutes": "10", "first": "100", "last": "300"}
    assert "ran_short" in found


def test_a_core_that_holds_too_much_was_not_foreseen() -> None:
    found = _rules(diagnosis="MEMORY_PRESSURE")
    assert "leak" in found
    assert "ran_short" not in found


def test_of_descriptors_no_memory_is_told() -> None:
    assert set(_rules(diagnosis="FD_EXHAUSTION")) & {"leak", "ran_short"} == {"ran_short"}


def test_the_kind_of_object_that_grew_is_named_where_it_was_counted() -> None:
    counted = {"growth": {"types": [{"name": "builtins.dict", "count": 900, "size_bytes": 9 * MIB}]}}
    made = replace(case(tape=GROWN, planned=True, diagnosis="LEAK"), memory=counted)
    assert "builtins.dict" in [one.values.get("type") for one in registry.examine(made)]


def test_another_core_has_only_bought_time_and_a_person_is_told_so() -> None:
    made = case(tape=GROWN, planned=True, diagnosis="LEAK")
    assert [one.says for one in proposals(made, registry.examine(made))] == ["find_the_leak"]
    asked = case(planned=True, diagnosis="OPERATOR")
    assert proposals(asked, registry.examine(asked)) == ()


def test_the_hours_before_are_read_off_the_state_of_the_real_recording() -> None:
    track = Track(MINUTE)
    for minute in range(31):
        track.look(minute * MINUTE, (100 + minute) * MIB, minute, 512 * MIB, 30 * MINUTE)
    state = CODEC.encode({"foresight": Foresight(1, tracks={Resource.MEMORY: track})})
    course = read_tape(json.dumps({"state": state}) + "\n").course
    assert course[0] == (-29 * 60.0, 100 * MIB)
    assert course[-1] == (0.0, 129 * MIB)
    assert read_tape('{"state": {"$map": [[1], "x", ["foresight", 3]]}}\n').course == ()
