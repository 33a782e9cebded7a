from typing import Any

import pytest

from frontend import catalogue_reports as texts
from frontend.catalogue_findings import FINDINGS
from postmortem import incident
from postmortem.analyzer import registry
from postmortem.analyzer.case import Case, Confidence, Finding, read_threads
from postmortem.analyzer.fingerprint import make_fingerprint
from postmortem.reports.report import finding_line
from tests.unit.postmortem import (
    story,
    test_rules_of_causes,
    test_rules_of_hangs,
    test_rules_of_the_guard,
)
from tests.unit.postmortem.story import frame, thread

TRACEBACK = """Fatal Python error: Segmentation fault

Thread 0x00007f1 (most recent call first):
  File "/somewhere/threading.py", line 300 in wait

Current thread 0x00007f2 (most recent call first):
  File "/somewhere/core/ledger/decider.py", line 88 in decide
  File "/somewhere/core/service.py", line 20 in run
"""
BUSY = thread(
    7,
    frame("sleep_on_it", 12, transaction_id='"tx-9"', account_id='"assets:kb"'),
    frame("handle", 30, account_ids='["assets:kb", "expenses:food"]'),
)


def case(
    threads: list[dict[str, Any]] | None = None,
    process: dict[str, Any] | None = None,
    traceback: str = "",
    **other: Any,
) -> Case:
    return Case(
        incident.from_facts(story.ID, story.facts(**other)),
        read_threads(threads),
        process or {},
        {},
        traceback,
    )


def found(one: Case) -> dict[str, Finding]:
    return {finding.rule: finding for finding in registry.examine(one)}


def ended(**how: int) -> dict[str, Any]:
    return {"pid": 7, "exit": how}


def test_a_crash_names_its_signal_and_the_frame_of_the_thread_that_died() -> None:
    finding = found(case(traceback=TRACEBACK, diagnosis="CRASHED", core=ended(signal=11)))["crashed_at"]
    assert finding.confidence is Confidence.CERTAIN
    assert finding.values == {"signal": "SIGSEGV", "place": "decide (decider.py:88)"}


def test_a_crash_without_a_traceback_still_names_its_signal() -> None:
    assert found(case(diagnosis="CRASHED", core=ended(signal=6)))["crashed"].values["signal"] == "SIGABRT"


@pytest.mark.parametrize(
    ("code", "rule"), [(65, "exited_65"), (75, "exited_75"), (3, "exited"), (0, "exited")]
)
def test_an_exit_says_what_its_code_means(code: int, rule: str) -> None:
    assert list(found(case(diagnosis="EXITED", core=ended(code=code), in_flight=[]))) == [rule]


def test_a_kill_from_outside_blames_no_command() -> None:
    finding = found(case())["killed"]
    assert finding.confidence is Confidence.CERTAIN
    assert "No command" in finding_line(finding, "en")


@pytest.mark.parametrize("diagnosis", ["LOOP_BLOCKED", "OPERATOR", "FROZEN", "UNKNOWN"])
def test_our_own_kill_is_never_called_one_from_outside(diagnosis: str) -> None:
    assert "killed" not in found(case(diagnosis=diagnosis, core=ended(signal=9)))


@pytest.mark.parametrize(
    ("states", "sure"), [("TTT", Confidence.CERTAIN), ("TSR", Confidence.LIKELY), ("", Confidence.LIKELY)]
)
def test_frozen_is_certain_only_when_every_thread_stood_still_before_us(
    states: str, sure: Confidence
) -> None:
    process = {"threads": [{"state": state} for state in states]}
    assert found(case(process=process, diagnosis="FROZEN"))["frozen"].confidence is sure


@pytest.mark.parametrize(
    ("diagnosis", "rule"), [("LOOP_BLOCKED", "blocked"), ("SPINNING", "spinning"), ("UNKNOWN", "was_in")]
)
def test_a_hang_names_frame_transaction_and_account(diagnosis: str, rule: str) -> None:
    finding = found(case([BUSY], {"pid": 7}, diagnosis=diagnosis, core=ended()))[rule]
    assert (finding.values["function"], finding.values["place"]) == ("sleep_on_it", "core/x.py:12")
    assert finding.transaction_ids == ("tx-9",)
    assert finding.account_ids == ("assets:kb", "expenses:food")


def test_a_loop_that_waits_for_events_is_not_blocked() -> None:
    idle = thread(7, frame("select"), frame("_run_once"), frame("run_forever"))
    worker = thread(8, frame("commit", transaction_id='"tx-1"'), name="writer")
    assert found(case([idle], {"pid": 7}, diagnosis="LOOP_BLOCKED", core=ended())) == {}
    finding = found(case([idle, worker], {"pid": 7}, diagnosis="LOOP_BLOCKED", core=ended()))["blocked"]
    assert (finding.values["function"], finding.confidence) == ("commit", Confidence.LIKELY)


@pytest.mark.parametrize(
    ("function", "file"),
    [("EpollSelector.select", "selectors.py"), ("Runner.run", "asyncio/runners.py"), ("poll", "x.py")],
)
def test_a_loop_at_rest_is_known_by_any_name_of_its_frame(function: str, file: str) -> None:
    assert (
        found(case([thread(7, frame(function, 1, file))], {"pid": 7}, diagnosis="LOOP_BLOCKED", core=ended()))
        == {}
    )


@pytest.mark.parametrize(
    ("seen", "said"),
    [
        ({"tid": 7, "state": "R", "wchan": "0"}, "running"),
        ({"tid": 7, "state": "S", "wchan": "futex_do_wait"}, "asleep (futex_do_wait)"),
        ({"tid": 8, "state": "R"}, "asleep"),
    ],
)
def test_what_a_thread_did_is_told_as_it_was_before_the_stop(seen: dict[str, Any], said: str) -> None:
    one = case([BUSY], {"pid": 7, "threads": [seen]}, diagnosis="SPINNING", core=ended())
    assert found(one)["spinning"].evidence[0] == f"thread MainThread {said} in sleep_on_it (core/x.py:12)"


def test_a_frame_about_several_accounts_names_each_of_them() -> None:
    busy = thread(7, frame("settle", account_id='"assets:kb,assets:cash"'))
    finding = found(case([busy], {"pid": 7}, diagnosis="LOOP_BLOCKED", core=ended()))["blocked"]
    assert finding.account_ids == ("assets:kb", "assets:cash")


def test_no_progress_counts_who_waited_where() -> None:
    worker = thread(8, frame("commit", transaction_id='"tx-1"'), name="writer")
    both = found(case([worker], diagnosis="NO_PROGRESS", core=ended()))
    assert "1 in DECIDING" in both["no_progress"].evidence[0]
    assert both["waits_in"].transaction_ids == ("tx-1",)


def test_what_somebody_asked_for_is_no_fault() -> None:
    wanted = case(planned=True, diagnosis="OPERATOR", reason="update", core=ended(code=0))
    assert list(found(wanted)) == ["operator_reason"]
    assert list(found(case(planned=True, diagnosis="OPERATOR", core=ended(code=0)))) == ["operator"]


def test_a_drill_is_told_as_a_drill() -> None:
    assert found(case(drill="crash", diagnosis="CRASHED", core=ended(signal=6)))["drill"].values == {
        "drill": "crash"
    }


def test_the_surest_finding_comes_first() -> None:
    worker = thread(8, frame("commit", transaction_id='"tx-1"'), name="writer")
    order = [
        one.confidence for one in registry.examine(case([worker], diagnosis="NO_PROGRESS", core=ended()))
    ]
    assert order == [Confidence.CERTAIN, Confidence.LIKELY]


def test_every_finding_has_a_sentence_in_each_language() -> None:
    cases = [
        case(traceback=TRACEBACK, diagnosis="CRASHED", core=ended(signal=11)),
        case(diagnosis="CRASHED", core=ended(signal=6)),
        *(case(diagnosis="EXITED", core=ended(code=code)) for code in (3, 65, 69, 73, 74, 75, 78)),
        case(),
        case(diagnosis="FROZEN"),
        *(
            case([BUSY], {"pid": 7}, diagnosis=word, core=ended())
            for word in ("LOOP_BLOCKED", "SPINNING", "UNKNOWN")
        ),
        case([BUSY], diagnosis="NO_PROGRESS", core=ended()),
        case(planned=True, reason="x", core=ended()),
        case(planned=True, core=ended()),
        case(drill="freeze"),
        *test_rules_of_hangs.every_rule(),
        *test_rules_of_causes.every_rule(),
        *test_rules_of_the_guard.every_rule(),
    ]
    seen = {finding.rule: finding for one in cases for finding in registry.examine(one)}
    seen |= {finding.rule: finding for finding in test_rules_of_causes.cut_short()}
    assert set(seen) == set(FINDINGS), "a rule without a sentence, or a sentence without a rule"
    for finding in seen.values():
        for language in texts.LANGUAGES:
            assert "{" not in finding_line(finding, language)


def fingerprint(one: Case) -> str:
    return make_fingerprint(one, registry.examine(one)).digest


def test_the_same_fault_has_the_same_fingerprint_whoever_it_hits() -> None:
    other = thread(
        9,
        frame("sleep_on_it", 99, transaction_id='"tx-other"', account_id='"assets:x"'),
        frame("handle", 31),
    )
    here = case([BUSY], {"pid": 7}, diagnosis="LOOP_BLOCKED", core=ended())
    there = case([other], {"pid": 9}, diagnosis="LOOP_BLOCKED", core={"pid": 9}, in_flight=[])
    assert fingerprint(here) == fingerprint(there)
    assert len(fingerprint(here)) == 16


def test_another_fault_has_another_fingerprint() -> None:
    prints = {
        fingerprint(case([BUSY], {"pid": 7}, diagnosis="LOOP_BLOCKED", core=ended())),
        fingerprint(case([BUSY], {"pid": 7}, diagnosis="SPINNING", core=ended())),
        fingerprint(
            case([thread(7, frame("elsewhere"))], {"pid": 7}, diagnosis="LOOP_BLOCKED", core=ended())
        ),
        fingerprint(case()),
        fingerprint(case(diagnosis="EXITED", core=ended(code=3))),
        fingerprint(case(diagnosis="NO_PROGRESS", core=ended())),
    }
    assert len(prints) == 6
