"""What is found where a gateway or a guard was lost: what is known, and nothing that is not."""

from typing import Any

import pytest

from postmortem import incident
from postmortem.analyzer import registry
from postmortem.analyzer.case import Case, Confidence, Finding, read_threads
from tests.unit.postmortem import story
from tests.unit.postmortem.story import frame, thread

PATH = "0123456789abcdef"


def gateway(*threads: dict[str, Any], **told: Any) -> Case:
    facts = story.facts(diagnosis="GATEWAY_LOST", core={"pid": None, "exit": None}, in_flight=[])
    return Case(
        incident.from_facts(story.ID, facts),
        read_threads(list(threads)),
        {"pid": 7},
        {},
        "",
        gateway={"ended": "died", "exit": None, "oom_kills": None, "requests": [], "refused_paths": []}
        | told,
    )


def sentinel(*evidence: str) -> Case:
    said = [{"kind": "sentinel page", "colour": "yellow", "text": text} for text in evidence]
    facts = story.facts(diagnosis="SENTINEL_LOST", core={"pid": 7, "exit": None}, evidence=said)
    return Case(incident.from_facts(story.ID, facts), (), {}, {}, "")


def every_rule() -> list[Case]:
    reading = [{"stage": "PARSING", "path_hash": PATH}]
    return [
        *(gateway(exit=how) for how in ({"signal": 9}, {"signal": 11}, {"code": 1}, {})),
        gateway(exit={"signal": 9}, oom_kills=1),
        gateway(exit={"signal": 9}, requests=reading, refused_paths=[PATH]),
        gateway(ended="FROZEN", last_sample={"state": "T"}),
        gateway(ended="SPINNING"),
        gateway(thread(7, frame("loads", 3), name="MainThread"), ended="SPINNING"),
        sentinel(),
        sentinel("nobody watched for 1200 ms"),
        sentinel("the guard before stood still, and was ended"),
        sentinel("nobody watched for 1200 ms", "the guard before stood still, and was ended"),
    ]


def found(case: Case) -> dict[str, Finding]:
    return {finding.rule: finding for finding in registry.examine(case)}


@pytest.mark.parametrize(
    ("how", "rule", "confidence"),
    [
        ({"signal": 9}, "gateway_killed", Confidence.CERTAIN),
        ({"signal": 11}, "gateway_crashed", Confidence.CERTAIN),
        ({"code": 70}, "gateway_exited", Confidence.CERTAIN),
        ({}, "gateway_untold", Confidence.UNKNOWN),
    ],
)
def test_what_ended_a_gateway_is_said_as_surely_as_it_is_known(
    how: dict[str, int], rule: str, confidence: Confidence
) -> None:
    assert found(gateway(exit=how))[rule].confidence is confidence


def test_a_kill_while_memory_had_run_out_is_only_likely_to_be_the_systems() -> None:
    case = found(gateway(exit={"signal": 9}, oom_kills=2))
    assert case["gateway_out_of_memory"].confidence is Confidence.LIKELY
    assert "gateway_killed" not in case


def test_a_path_is_named_only_where_it_was_refused_for_this_death() -> None:
    reading = [{"stage": "PARSING", "path_hash": PATH}]
    assert "gateway_poison" not in found(gateway(exit={"signal": 9}, requests=reading))
    assert "gateway_poison" not in found(gateway(exit={"signal": 9}, refused_paths=[PATH]))
    case = found(gateway(exit={"signal": 9}, requests=reading, refused_paths=[PATH]))
    assert case["gateway_poison"].values == {"path": PATH}
    assert case["gateway_poison"].confidence is Confidence.LIKELY


def test_a_gateway_that_hung_is_placed_where_its_loop_stood() -> None:
    case = found(gateway(thread(7, frame("loads", 3), name="MainThread"), ended="SPINNING"))
    assert case["gateway_hung_in"].values["function"] == "loads"


def test_the_cores_own_rules_have_nothing_to_say_of_a_gateway() -> None:
    for case in every_rule():
        rules = set(found(case))
        assert all(rule.startswith(("gateway_", "sentinel_")) for rule in rules), rules


def test_how_long_nobody_watched_is_said_where_it_is_on_record() -> None:
    assert found(sentinel("nobody watched for 1200 ms"))["sentinel_gone_for"].values == {"seconds": "1.2"}
    assert found(sentinel())["sentinel_gone"].confidence is Confidence.UNKNOWN


def test_whatever_a_gateway_has_left_no_rule_falls_over_it() -> None:
    strange = {"exit": "9", "requests": 3, "refused_paths": {"a": 1}, "oom_kills": [], "last_sample": 1}
    for ended in ("died", "FROZEN", "", 5):
        assert "not_asked" not in found(gateway(**strange, ended=ended))
