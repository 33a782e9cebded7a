import dataclasses
import json
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.flight import CODEC
from hardcore.recovery.policy import (
    DEFAULT_ACTIONS,
    HUNG,
    LIVING,
    WORDS_MAX,
    Policy,
    PolicyFault,
    Word,
    in_full,
    read_policy,
    shipped_text,
)


def _faults(text: str | dict[str, Any]) -> list[PolicyFault]:
    found = read_policy(text if isinstance(text, str) else json.dumps(text, indent=1))
    assert isinstance(found, list), "it was taken"
    return found


def _policy(text: str | dict[str, Any]) -> Policy:
    found = read_policy(text if isinstance(text, str) else json.dumps(text))
    assert isinstance(found, Policy), found
    return found


def test_an_empty_file_of_settings_means_the_defaults() -> None:
    assert _policy("{}") == Policy()


def test_the_shipped_text_passes_its_own_check_and_says_the_defaults() -> None:
    assert _policy(shipped_text()) == Policy()


def test_a_file_may_name_only_what_differs() -> None:
    assert _policy({"probation_ms": 5}) == Policy(probation_ms=5)


# What the contract wants refused, each with its line and reason.


def test_an_unknown_setting_is_refused_with_its_line() -> None:
    assert _faults('{\n "version": 1,\n "restart_forever": true\n}') == [
        PolicyFault(3, "restart_forever", "is not a setting of this version")
    ]


def test_an_unknown_diagnosis_is_refused() -> None:
    (fault,) = _faults('{\n"actions": {\n"GREMLINS": ["NONE"]}}')
    assert (fault.line, fault.name) == (3, "GREMLINS")


def test_an_unknown_word_is_refused() -> None:
    (fault,) = _faults('{\n"actions": {\n\n"CRASHED": ["SEND_ALERT", "PANIC"]}}')
    assert (fault.line, fault.name) == (4, "CRASHED")
    assert "'PANIC'" in fault.reason


def test_a_timeout_shorter_than_its_looks_is_refused() -> None:
    (fault,) = _faults({"health_check_timeout_ms": 299})
    assert fault.name == "health_check_timeout_ms"
    assert isinstance(_policy({"health_check_timeout_ms": 300}), Policy)


def test_a_deadlock_confirmed_before_a_beat_is_late_is_refused() -> None:
    (fault,) = _faults({"confirm_deadlock_ms": 300})
    assert fault.name == "confirm_deadlock_ms"
    assert isinstance(_policy({"confirm_deadlock_ms": 301}), Policy)


def test_a_hang_confirmed_before_a_deadlock_is_refused() -> None:
    (fault,) = _faults({"confirm_hang_ms": 399})
    assert fault.name == "confirm_hang_ms"
    assert isinstance(_policy({"confirm_hang_ms": 400}), Policy)


def test_leader_election_is_refused() -> None:
    (fault,) = _faults({"enable_leader_election": True})
    assert "not in this version" in fault.reason
    assert isinstance(_policy({"enable_leader_election": False}), Policy)


@pytest.mark.parametrize("mode", ["act", "assist", "observe"])
def test_each_mode_is_taken_and_no_other(mode: str) -> None:
    assert _policy({"mode": mode}).mode == mode
    (fault,) = _faults({"mode": f"{mode}ing"})
    assert fault.name == "mode"


def test_a_faulty_channel_is_refused_with_the_line_of_its_field() -> None:
    text = '{"alerts": [\n {"kind": "ntfy",\n  "url": "https://example.org/topic"},\n {"kind": "ntfy",\n  "url": "x"}\n]}'
    (fault,) = _faults(text)
    assert (fault.line, fault.name) == (5, "alerts")
    assert "channel 2" in fault.reason


def test_a_channel_without_an_address_is_refused_at_its_own_line() -> None:
    (fault,) = _faults('{"alerts": [\n\n {"kind": "ntfy"}]}')
    assert fault.line == 3


def test_a_recording_carries_no_address_of_a_channel() -> None:
    policy = _policy({"alerts": [{"kind": "ntfy", "url": "https://example.org/t0psecret"}]})
    assert len(policy.alerts) == 1
    for told in (in_full(policy), CODEC.encode(policy)):
        assert "t0psecret" not in json.dumps(told)


def test_the_same_name_in_another_object_is_not_where_the_fault_is() -> None:
    text = '{"gateway": {\n"hold_ms": 5},\n"actions": {\n"FROZEN": ["NONE"],\n"LEAK": ["REBOOT_PROCESS"]}}'
    (fault,) = _faults(text)
    assert (fault.line, fault.name) == (5, "LEAK")


@pytest.mark.parametrize(
    "words",
    [
        ["REBOOT_PROCESS", "SHUTDOWN"],
        ["NONE", "SEND_ALERT"],
        ["DEGRADE"],
        [],
        "SEND_ALERT",
        ["RESTART_COMPONENT"],
    ],
)
def test_what_is_done_when_nobody_comes_is_one_thing_that_can_be_done(words: object) -> None:
    (fault,) = _faults({"on_await_timeout": words})
    assert fault.name == "on_await_timeout"


def test_a_person_is_told_again_by_default_when_nobody_comes() -> None:
    assert Policy().on_await_timeout == (Word.SEND_ALERT,)


def test_a_longest_pause_shorter_than_the_first_is_refused() -> None:
    (fault,) = _faults({"backoff_max_ms": 10, "backoff_initial_ms": 20})
    assert fault.name == "backoff_max_ms"


def test_another_version_is_refused() -> None:
    assert [fault.name for fault in _faults({"version": 2})] == ["version"]


def test_a_ledger_that_may_be_damaged_is_never_restarted_by_a_policy() -> None:
    for word in (Word.REBOOT_PROCESS, Word.RESTART_COMPONENT, Word.PLANNED_SWITCH):
        (fault,) = _faults({"actions": {"STORE_CORRUPT": [word]}})
        assert fault.name == "STORE_CORRUPT"


def test_none_stands_alone() -> None:
    (fault,) = _faults({"actions": {"CRASHED": ["NONE", "SEND_ALERT"]}})
    assert "NONE" in fault.reason


def test_restarting_and_waiting_exclude_each_other() -> None:
    (fault,) = _faults({"actions": {"CRASHED": ["REBOOT_PROCESS", "SAFE_MODE_ENTER"]}})
    assert "only one of the two" in fault.reason


def test_staying_down_and_reading_only_exclude_each_other() -> None:
    (fault,) = _faults({"actions": {"CRASHED": ["SHUTDOWN", "SAFE_MODE_ENTER"]}})
    assert "only one of the two" in fault.reason


def test_waiting_for_the_operator_may_be_done_while_reads_are_served() -> None:
    assert isinstance(_policy({"actions": {"DISK_FULL": ["AWAIT_OPERATOR", "SAFE_MODE_ENTER"]}}), Policy)


def test_a_transaction_that_is_over_time_before_a_beat_is_late_is_refused() -> None:
    (fault,) = _faults({"transaction_timeout_ms": 300})
    assert fault.name == "transaction_timeout_ms"
    assert isinstance(_policy({"transaction_timeout_ms": 301}), Policy)


@pytest.mark.parametrize("word", ["never", "on_request", "always"])
def test_a_memory_image_is_a_wish_of_the_policy(word: str) -> None:
    assert _policy({"memory_image": word}).memory_image == word


def test_the_words_are_a_set() -> None:
    twice = _policy({"actions": {"CRASHED": ["SNAPSHOT", "SEND_ALERT", "SNAPSHOT"]}})
    assert twice.words(Diagnosis.CRASHED) == {Word.SNAPSHOT, Word.SEND_ALERT}


@pytest.mark.parametrize("words", [[], None, "REBOOT_PROCESS", {}, [1], [["NONE"]], [None]])
def test_a_list_of_words_is_a_list_of_words(words: object) -> None:
    assert [fault.name for fault in _faults({"actions": {"CRASHED": words}})] == ["CRASHED"]


def test_a_name_that_stands_twice_is_refused_at_its_second_line() -> None:
    assert _faults('{"probation_ms": 1,\n"mode": "act",\n"probation_ms": 2}') == [
        PolicyFault(3, "probation_ms", "stands there twice")
    ]


def test_a_diagnosis_that_stands_twice_is_refused() -> None:
    (fault,) = _faults('{"actions": {"CRASHED": ["NONE"],\n"CRASHED": ["SEND_ALERT"]}}')
    assert (fault.line, fault.name) == (2, "CRASHED")


def test_everything_that_is_wrong_is_told_at_once_in_the_order_of_its_lines() -> None:
    text = '{"version": 1,\n"probation_ms": -1,\n"actions": {"X": []},\n"gateway": {"hold_ms": "x"},\n"spare": 1}'
    assert [(fault.line, fault.name) for fault in _faults(text)] == [
        (2, "probation_ms"),
        (3, "X"),
        (4, "hold_ms"),
        (5, "spare"),
    ]


@pytest.mark.parametrize("text", ["", "{", "nope", '{"mode": "act",}', '{"probation_ms": 08}', "\x00"])
def test_what_is_no_json_is_refused_with_its_line(text: str) -> None:
    (fault,) = _faults(text)
    assert fault.line == 1
    assert fault.reason.startswith("not JSON")


@pytest.mark.parametrize("text", ["[]", "null", '"act"', "3", "[" * 100])
def test_what_is_no_object_is_refused(text: str) -> None:
    assert len(_faults(text)) == 1


#: A busy machine makes an example slow; that says nothing about the rule.
UNTIMED = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])

HOSTILE = [
    "[" * 200_000,
    '{"probation_ms": ' + "9" * 5000 + "}",
    '{"probation_ms": NaN}',
    '{"probation_ms": 1e400}',
    '{"\\ud800": 1}',
    '{"\\u001b[31m": 1}',
    '{"' + "x" * 100_000 + '": 1}',
    '{"mode": "' + "y" * 100_000 + '"}',
    '{"actions": {"CRASHED": ["\\ud800\\u0007"]}}',
    '{"gateway": []}',
    '{"actions": []}',
]


@pytest.mark.parametrize("text", HOSTILE, ids=range(len(HOSTILE)))
def test_a_hostile_file_is_refused_in_words_that_a_terminal_can_show(text: str) -> None:
    for fault in _faults(text):
        line = str(fault)
        assert line.isprintable()
        assert len(line) < 2 * WORDS_MAX + 100
        line.encode("utf-8")


_json = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)
_names = st.sampled_from([f.name for f in dataclasses.fields(Policy)] + ["alerts", "gateway", "actions"])


@UNTIMED
@given(st.dictionaries(_names, _json, max_size=4))
def test_no_value_of_any_kind_raises(values: dict[str, object]) -> None:
    found = read_policy(json.dumps(values))
    assert isinstance(found, Policy) or all(isinstance(fault, PolicyFault) for fault in found)


@UNTIMED
@given(st.text(max_size=50))
def test_no_text_raises(text: str) -> None:
    assert read_policy(text) is not None


@pytest.mark.parametrize(
    ("diagnosis", "word"),
    [
        *((hang, "SAFE_MODE_ENTER") for hang in sorted(HUNG)),
        *((alive, "SHUTDOWN") for alive in sorted(LIVING)),
        ("CRASHED", "DEGRADE"),
        ("SENTINEL_LOST", "AWAIT_OPERATOR"),
        ("OPERATOR", "SAFE_MODE_ENTER"),
        ("STARVED", "REBOOT_PROCESS"),
        ("SLEPT", "SEND_ALERT"),
        ("CRASH_LOOP", "REBOOT_PROCESS"),
        ("FROZEN", "RESTART_COMPONENT"),
        ("FROZEN", "PLANNED_SWITCH"),
        ("LEAK", "REBOOT_PROCESS"),
        ("MEMORY_PRESSURE", "SAFE_MODE_ENTER"),
        ("GATEWAY_LOST", "SHUTDOWN"),
    ],
)
def test_a_word_that_can_not_be_done_on_a_diagnosis_is_refused_with_line_and_reason(
    diagnosis: str, word: str
) -> None:
    (fault,) = _faults(f'{{\n"actions": {{\n"{diagnosis}": ["{word}"]}}}}')
    assert (fault.line, fault.name) == (3, diagnosis)


def test_what_is_done_by_default_can_be_written_down() -> None:
    everything = {str(diagnosis): sorted(map(str, words)) for diagnosis, words in DEFAULT_ACTIONS.items()}
    assert isinstance(read_policy(json.dumps({"actions": everything})), Policy)


# What a policy means.


@pytest.mark.parametrize("diagnosis", Diagnosis)
def test_what_is_not_listed_is_answered_by_the_default_table(diagnosis: Diagnosis) -> None:
    assert Policy().words(diagnosis) == DEFAULT_ACTIONS[diagnosis]


def test_what_is_listed_replaces_the_default_whole() -> None:
    policy = _policy({"actions": {"CRASHED": ["SEND_ALERT"]}})
    assert not policy.asks(Diagnosis.CRASHED, Word.REBOOT_PROCESS)
    assert policy.asks(Diagnosis.EXITED, Word.REBOOT_PROCESS)


def test_reading_only_is_a_word_that_is_meant_in_full() -> None:
    policy = _policy({"actions": {"DB_LOCKED": ["SAFE_MODE_ENTER"]}})
    assert policy.asks(Diagnosis.DB_LOCKED, Word.SAFE_MODE_ENTER)


def test_a_damaged_ledger_is_not_restarted_by_default() -> None:
    assert not Policy().asks(Diagnosis.STORE_CORRUPT, Word.REBOOT_PROCESS)


def test_the_limits_of_the_gateway_come_from_the_same_file() -> None:
    assert _policy({"gateway": {"hold_ms": 5}}).gateway.hold_ms == 5


def test_a_file_that_is_nested_without_end_is_refused_before_it_fills_the_memory() -> None:
    text = '{"gateway":' + "[" * 900 + "1," * 50_000 + "1" + "]" * 900 + "}"
    faults = read_policy(text)
    assert isinstance(faults, list)
    assert "nested" in faults[0].reason
