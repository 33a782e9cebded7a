import pytest

from hardcore.model.phases import Phase
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery import plan
from hardcore.recovery.budget import NS_PER_MS, NS_PER_S
from hardcore.recovery.policy import Policy, Word


def test_a_death_inside_the_budget_is_tried_again() -> None:
    assert plan.hopeless(Policy(), Diagnosis.CRASHED, spent=False) is None


def test_a_spent_budget_is_a_crash_loop() -> None:
    assert plan.hopeless(Policy(), Diagnosis.CRASHED, spent=True) is Diagnosis.CRASH_LOOP


@pytest.mark.parametrize(
    "diagnosis",
    [Diagnosis.STORE_CORRUPT, Diagnosis.CONFIG_INVALID, Diagnosis.DISK_FULL, Diagnosis.DB_LOCKED],
)
def test_what_a_restart_would_not_heal_is_not_tried_again(diagnosis: Diagnosis) -> None:
    assert plan.hopeless(Policy(), diagnosis, spent=False) is diagnosis


@pytest.mark.parametrize(
    "diagnosis", [Diagnosis.STORE_CORRUPT, Diagnosis.DISK_FULL, Diagnosis.DISK_READ_ONLY]
)
def test_a_core_may_serve_reads_where_the_policy_says_so_and_it_was_not_just_tried(
    diagnosis: Diagnosis,
) -> None:
    assert plan.may_read(Policy(), diagnosis, tried=False)
    assert not plan.may_read(Policy(), diagnosis, tried=True)
    waits = Policy(actions={diagnosis: frozenset({Word.AWAIT_OPERATOR})})
    assert not plan.may_read(waits, diagnosis, tried=False)


@pytest.mark.parametrize("reason", [None, Diagnosis.CONFIG_INVALID, Diagnosis.CRASH_LOOP, Diagnosis.CRASHED])
def test_nothing_else_makes_a_core_that_only_reads(reason: Diagnosis | None) -> None:
    assert not plan.may_read(Policy(), reason, tried=False)


def test_whoever_reads_needs_no_lock_and_a_policy_that_keeps_the_core_keeps_reading() -> None:
    assert plan.may_read(Policy(), Diagnosis.DB_LOCKED, tried=False)
    assert not plan.may_read(Policy(), Diagnosis.DB_LOCKED, tried=True)
    told = Policy(actions={Diagnosis.DB_LOCKED: frozenset({Word.SEND_ALERT})})
    assert not plan.may_read(told, Diagnosis.DB_LOCKED, tried=False)


def test_a_lock_is_waited_for_unless_the_policy_wants_a_person() -> None:
    assert plan.passes(Policy(), Diagnosis.DB_LOCKED)
    assert not plan.passes(Policy(), Diagnosis.DISK_FULL)
    waits = Policy(actions={Diagnosis.DB_LOCKED: frozenset({Word.AWAIT_OPERATOR})})
    assert not plan.passes(waits, Diagnosis.DB_LOCKED)


def test_a_person_is_waited_for_where_only_a_person_helps() -> None:
    assert plan.waits_for(Phase.RUNNING, None, Diagnosis.STORE_CORRUPT) == "STORE_CORRUPT"
    assert plan.waits_for(Phase.RUNNING, None, Diagnosis.DISK_FULL) is None
    assert plan.waits_for(Phase.FATAL, Diagnosis.DISK_FULL, None) == "DISK_FULL"


def test_every_number_of_the_watch_reaches_the_bench() -> None:
    patience = plan.patience(Policy())
    assert (patience.gc_grace_ms, patience.transaction_ms, patience.disk_slow_ms) == (5000, 5000, 2000)
    assert (patience.memory_bytes, patience.disk_floor_bytes) == (512 << 20, 16 << 20)


def test_an_image_of_the_memory_has_its_own_time_beside_the_evidence() -> None:
    policy = Policy(snapshot_budget_ms=400, memory_image_budget_ms=3000)
    limit_ns = plan.limit_ns(policy, Phase.SNAPSHOT_LIVE, 0, None, imaged=True)
    assert limit_ns == (3400 + plan.EVIDENCE_SLACK_MS) * NS_PER_MS


def test_the_policy_says_what_is_not_tried_again() -> None:
    policy = Policy(actions={Diagnosis.CRASHED: frozenset({Word.SEND_ALERT})})
    assert plan.hopeless(policy, Diagnosis.CRASHED, spent=False) is Diagnosis.CRASHED


def test_a_proven_core_is_replaced_at_once() -> None:
    assert plan.pause_ns(Policy(), tries=0, jitter=0.5) == 0


def test_the_successor_of_an_unproven_core_waits_longer_and_longer() -> None:
    pauses = [plan.pause_ns(Policy(), tries, jitter=0.0) // NS_PER_MS for tries in (1, 2, 3)]
    assert pauses == [500, 1000, 2000]


def test_a_delay_the_policy_asks_for_is_kept() -> None:
    assert plan.pause_ns(Policy(restart_delay_ms=70), tries=0, jitter=1.0) == 70 * NS_PER_MS


@pytest.mark.parametrize("phase", Phase)
def test_every_phase_has_an_answer_to_how_long(phase: Phase) -> None:
    limit_ns = plan.limit_ns(Policy(), phase, 5, Diagnosis.CRASH_LOOP)
    assert limit_ns is None or limit_ns > 0


def test_evidence_gets_its_budget_and_a_little_to_hand_over_what_it_has() -> None:
    limit_ns = plan.limit_ns(Policy(snapshot_budget_ms=400), Phase.SNAPSHOT_LIVE, 0, None)
    assert limit_ns == (400 + plan.EVIDENCE_SLACK_MS) * NS_PER_MS


def test_only_a_spent_budget_is_tried_again_by_itself() -> None:
    policy = Policy(slow_retry_sec=300)
    assert plan.limit_ns(policy, Phase.FATAL, 0, Diagnosis.CRASH_LOOP) == 300 * NS_PER_S
    assert plan.limit_ns(policy, Phase.FATAL, 0, Diagnosis.STORE_CORRUPT) is None


def test_the_slow_retry_can_be_turned_off() -> None:
    assert plan.limit_ns(Policy(slow_retry_sec=0), Phase.FATAL, 0, Diagnosis.CRASH_LOOP) is None
