from itertools import product

import pytest

from frontend.catalogue_policy import EXPLAINED, LANGUAGES, explained
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.explain import Line, Said, explain
from hardcore.recovery.policy import Policy, Word


def _said(diagnosis: Diagnosis, policy: Policy | None = None) -> list[Said]:
    return [line.said for line in explain(policy or Policy(), diagnosis)]


@pytest.mark.parametrize("diagnosis", Diagnosis)
def test_every_diagnosis_is_explained_in_both_languages(diagnosis: Diagnosis) -> None:
    for line, lang in product(explain(Policy(), diagnosis), LANGUAGES):
        assert explained(line.said, dict(line.numbers), lang)


def test_every_sentence_has_its_words_and_every_word_its_sentence() -> None:
    assert set(EXPLAINED) == set(Said)


def test_a_number_stands_beside_its_setting() -> None:
    (line, *_) = explain(Policy(confirm_deadlock_ms=777), Diagnosis.DEADLOCK)
    assert line == Line(Said.CONCLUSIVE, (("confirm_deadlock_ms", 777),))
    assert "777 ms (confirm_deadlock_ms)" in explained(line.said, dict(line.numbers), "en")


def test_a_hang_is_ended_after_its_evidence() -> None:
    said = _said(Diagnosis.LOOP_BLOCKED)
    assert said.index(Said.EVIDENCE_FIRST) < said.index(Said.ENDED_AND_STARTED)
    assert said[-1] is Said.SUSPECTS_TOUCHED


def test_the_evidence_of_a_dead_core_is_what_it_left() -> None:
    assert Said.EVIDENCE_LEFT in _said(Diagnosis.CRASHED)
    assert Said.EVIDENCE_FIRST not in _said(Diagnosis.CRASHED)


def test_a_full_disk_is_read_only_until_a_write_is_taken() -> None:
    said = _said(Diagnosis.DISK_FULL)
    assert {Said.EVIDENCE_BESIDE, Said.READS_ONLY, Said.TRIES_TO_WRITE, Said.SUSPECTS_NOBODY} <= set(said)
    assert Said.ENDED_AND_STARTED not in said


def test_a_damaged_ledger_waits_for_a_person() -> None:
    assert Said.READS_UNTIL_RESUME in _said(Diagnosis.STORE_CORRUPT)


def test_a_locked_ledger_ends_nobody() -> None:
    said = _said(Diagnosis.DB_LOCKED)
    assert Said.GOES_ON in said
    assert Said.ENDED_AND_STARTED not in said


def test_a_lock_at_the_start_is_waited_for_and_reads_are_served_meanwhile() -> None:
    assert {Said.WAITS_FOR_LOCK, Said.READS_MEANWHILE} <= set(_said(Diagnosis.DB_LOCKED))
    tells = Policy(actions={Diagnosis.DB_LOCKED: frozenset({Word.SEND_ALERT})})
    assert Said.READS_MEANWHILE not in _said(Diagnosis.DB_LOCKED, tells)
    waits = Policy(actions={Diagnosis.DB_LOCKED: frozenset({Word.AWAIT_OPERATOR})})
    assert {Said.LEFT_ALONE} == {Said.LEFT_ALONE, Said.WAITS_FOR_LOCK} & set(
        _said(Diagnosis.DB_LOCKED, waits)
    )


def test_a_hang_that_is_left_alone_is_not_said_to_go_on() -> None:
    tells = Policy(actions={Diagnosis.LOOP_BLOCKED: frozenset({Word.SEND_ALERT})})
    assert Said.LEFT_ALONE in _said(Diagnosis.LOOP_BLOCKED, tells)
    assert Said.GOES_ON not in _said(Diagnosis.LOOP_BLOCKED, tells)


@pytest.mark.parametrize("diagnosis", [Diagnosis.STARVED, Diagnosis.SLEPT])
def test_what_is_never_acted_on_is_said_to_be_so(diagnosis: Diagnosis) -> None:
    assert _said(diagnosis) == [Said.NEVER_ACTED_ON]


def test_a_leak_is_foreseen_and_switched_in_a_quiet_moment() -> None:
    assert _said(Diagnosis.LEAK) == [Said.FORESEEN, Said.ALERT, Said.SWITCHED_IN_QUIET]


def test_a_part_that_stands_still_is_started_alone_first() -> None:
    assert _said(Diagnosis.COMPONENT_STALLED) == [
        Said.PART_SILENT,
        Said.ALERT,
        Said.PART_STARTED,
        Said.SWITCHED_IN_QUIET,
    ]


def test_a_gateway_that_no_word_restarts_waits_for_a_person() -> None:
    nothing = Policy(actions={Diagnosis.GATEWAY_LOST: frozenset({Word.NONE})})
    assert _said(Diagnosis.GATEWAY_LOST, nothing) == [
        Said.GATEWAY_GONE,
        Said.GATEWAY_LEFT,
        Said.AGENTS_REST,
    ]
    assert Said.GATEWAY_STARTED in _said(Diagnosis.GATEWAY_LOST)


def test_a_mode_is_told_before_what_it_keeps_from_being_done() -> None:
    watched = _said(Diagnosis.FROZEN, Policy(mode="observe"))
    assert watched.index(Said.ONLY_RECORDED) < watched.index(Said.ENDED_AND_STARTED)
    assert Said.ALERT not in watched, "observe tells nobody"
    asked = _said(Diagnosis.FROZEN, Policy(mode="assist"))
    assert asked.index(Said.WAITS_FOR_WORD) < asked.index(Said.ENDED_AND_STARTED) < asked.index(Said.OVERDUE)


def test_what_is_done_when_nobody_comes_is_told_where_somebody_is_waited_for() -> None:
    stops = Policy(on_await_timeout=("SHUTDOWN",))
    assert Said.OVERDUE_STOP in _said(Diagnosis.CRASH_LOOP, stops)
    assert Said.OVERDUE_STOP not in _said(Diagnosis.CRASHED, stops)
    assert Said.OVERDUE not in _said(Diagnosis.CRASH_LOOP, Policy(on_await_timeout=("NONE",)))


def test_the_policy_in_force_is_explained_and_not_the_shipped_one() -> None:
    waits = Policy(actions={Diagnosis.CRASHED: frozenset({Word.SHUTDOWN})})
    assert Said.SHUT_DOWN in _said(Diagnosis.CRASHED, waits)
    quiet = Policy(actions={Diagnosis.CRASHED: frozenset({Word.NONE})})
    assert Said.NOTHING in _said(Diagnosis.CRASHED, quiet)


def test_memory_suspects_only_what_grew() -> None:
    assert _said(Diagnosis.OUT_OF_MEMORY)[-1] is Said.SUSPECTS_GROWN


def test_what_concerns_the_spare_ends_no_core() -> None:
    assert _said(Diagnosis.SPARE_LOST) == [Said.ALERT, Said.SPARES_GIVEN_UP]
    assert _said(Diagnosis.PLANNED_SWITCH) == [Said.ALERT, Said.SWITCH_GIVEN_UP]


def test_a_core_that_is_found_serving_is_gone_on_with() -> None:
    assert Said.ADOPTED in _said(Diagnosis.SENTINEL_LOST)
