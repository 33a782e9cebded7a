"""What each diagnosis acts on, and what it never acts on, tick by tick."""

from typing import Any

import pytest
from msgspec.structs import replace

from hardcore.model.looks import StackFrame, ThreadStack
from hardcore.model.observations import Probed, StacksSampled
from hardcore.model.verdicts import Colour, Diagnosis, Grade
from hardcore.sentinel.verdict import TABLE
from tests.unit.sentinel import traces
from tests.unit.sentinel.traces import (
    DECIDER,
    PATIENCE,
    Look,
    at_ns_of,
    computing,
    deciding,
    deciding_since,
    heard,
    judged,
    named,
    red,
    silent,
    well,
)

LONG_MS = 20_000
WELL = well(1000)


def test_each_diagnosis_stands_in_the_table_once() -> None:
    assert len({diagnosis for diagnosis, _ in TABLE}) == len(TABLE)


# SPINNING


def _stacks(at_ms: int, *places: tuple[str, int], tid: int = 1) -> StacksSampled:
    frames = tuple(StackFrame(function, "app.py", line) for function, line in places)
    return StacksSampled(at_ns_of(at_ms), 1, (ThreadStack(tid, "loop", True, True, frames),))


def test_a_loop_that_computes_for_long_iscomputing() -> None:
    assert named(judged(WELL + computing(4000))) == (Diagnosis.SPINNING, Grade.LIKELY)


def test_a_loop_found_in_the_same_place_twice_is_spinning_for_certain() -> None:
    outer = [("handle", 7), ("run", 1)]
    told = [_stacks(1400, ("spin", 5), *outer), _stacks(1700, ("helper", 2), ("spin", 6), *outer)]
    assert named(heard(WELL + computing(4000), told)) == (Diagnosis.SPINNING, Grade.CERTAIN)


def test_a_loop_found_elsewhere_each_time_is_given_four_times_as_long() -> None:
    def told(n: int) -> tuple[tuple[str, int], ...]:
        return (*((f"f{n}.{depth}", depth) for depth in range(6)), ("run", n))

    looks = WELL + computing(9000)
    verdicts = heard(looks, [_stacks(1400, *told(1)), _stacks(1700, *told(2))])
    assert named(verdicts) == (Diagnosis.SPINNING, Grade.LIKELY)
    first = looks[[verdict.colour for verdict in verdicts].index(Colour.RED)]
    assert first.loop_age_ms > 4 * PATIENCE.hang_ms


def test_time_in_which_a_loop_was_not_scheduled_is_no_time_of_its_own() -> None:
    # 20 neighbours: what takes a second of processor time takes twenty by the wall.
    assert named(judged(WELL + computing(LONG_MS, percent=5))) is None


def test_what_is_completed_begins_the_time_anew() -> None:
    looks = [replace(look, submitted=99, completed=look.at_ms // 1000) for look in computing(LONG_MS)]
    assert named(judged(WELL + looks)) is None


def test_a_collection_of_memory_has_its_own_time() -> None:
    collecting = [replace(look, gc_since_ms=1010) for look in computing(8000)]
    assert named(judged(WELL + collecting[:40])) is None
    assert named(judged(WELL + collecting)) == (Diagnosis.SPINNING, Grade.LIKELY)


def test_a_collection_just_over_is_not_held_against_the_loop() -> None:
    looks = computing(4000)
    collecting = [replace(look, gc_since_ms=1010) for look in looks[:25]]
    assert named(judged(WELL + collecting + looks[25:30])) is None


# GIL_HELD


def _held(for_ms: int, *, asleep: bool, busy: int | None = 0, beat: bool = True) -> list[Look]:
    return [
        Look(
            at,
            at - 1000,
            at - 1000,
            loop=traces.NAPPING if asleep else traces.asking(at),
            beat=traces.asking(at) if beat else None,
            busy=busy,
            burned_ms=0,
        )
        for at in range(1070, 1000 + for_ms, 100)
    ]


@pytest.mark.parametrize("asleep", [True, False], ids=["by the loop", "by another"])
def test_an_interpreter_whose_holder_sleeps_is_held_for_certain(asleep: bool) -> None:
    looks = WELL + _held(2500, asleep=asleep)
    verdicts = judged(looks)
    assert named(verdicts) == (Diagnosis.GIL_HELD, Grade.CERTAIN)
    assert looks[[v.colour for v in verdicts].index(Colour.RED)].loop_age_ms < PATIENCE.hang_ms


@pytest.mark.parametrize(("every_ms", "found"), [(16, Diagnosis.GIL_HELD), (50, None)])
def test_a_core_in_which_somebody_asks_for_the_interpreter_now_and_then_is_not_called_over(
    every_ms: int, found: Diagnosis | None
) -> None:
    # Asking costs less than a step of the process's time, so that does not grow.
    looks = [
        Look(
            at,
            at - 1000,
            at - 1000,
            loop=traces.LOCKED,
            beat=traces.asking(at, every_ms),
            busy=0,
            burned_ms=0,
        )
        for at in range(1070, 4000, 100)
    ]
    verdict = red(judged(WELL + looks))
    assert (verdict and verdict.diagnosis) is found


def test_an_interpreter_held_by_nobody_knows_whom_is_given_the_longer_time() -> None:
    looks = WELL + _held(2500, asleep=False, busy=None)
    verdicts = judged(looks)
    assert named(verdicts) == (Diagnosis.GIL_HELD, Grade.LIKELY)
    assert looks[[v.colour for v in verdicts].index(Colour.RED)].loop_age_ms > PATIENCE.hang_ms


def test_a_holder_that_is_ready_or_waits_for_a_disk_is_not_asleep() -> None:
    assert named(judged(WELL + _held(LONG_MS, asleep=False, busy=1))) is None


def test_nobody_holds_an_interpreter_that_nobody_asks_for() -> None:
    assert named(judged(WELL + _held(LONG_MS, asleep=False, beat=False))) is None


def _holding(for_ms: int, **more: Any) -> list[Look]:
    return [
        Look(at, at - 1000, at - 1000, state="R", loop=traces.asking(at), burned_ms=at, **more)
        for at in range(1070, 1000 + for_ms, 100)
    ]


def test_a_thread_that_computes_and_lets_nobody_run_holds_the_interpreter() -> None:
    assert named(judged(WELL + _holding(4000))) == (Diagnosis.GIL_HELD, Grade.LIKELY)


def test_a_large_computation_of_a_moment_holds_nothing() -> None:
    assert named(judged(WELL + _holding(1400) + [Look(2470)])) is None


def test_a_full_collection_holds_the_interpreter_only_past_its_grace() -> None:
    assert named(judged(WELL + _holding(4500, gc_since_ms=1010))) is None
    assert named(judged(WELL + _holding(7000, gc_since_ms=1010))) == (Diagnosis.GIL_HELD, Grade.LIKELY)


def test_a_loop_that_is_ready_and_not_scheduled_waits_for_no_interpreter() -> None:
    looks = [replace(look, loop=traces.unlet(look.at_ms)) for look in _holding(LONG_MS)]
    assert named(judged(WELL + looks)) is None


# TRANSACTION_TIMEOUT


def test_a_command_over_its_time_is_called_so_and_blamed() -> None:
    verdict = red(judged(deciding(2000)))
    assert verdict is not None
    assert (verdict.diagnosis, verdict.grade) == (Diagnosis.TRANSACTION_TIMEOUT, Grade.CERTAIN)
    assert verdict.blamed == ("c1",)
    assert verdict.fault_ns == at_ns_of(100)


def test_a_slow_read_has_a_limit_of_its_own() -> None:
    notes = deciding_since(100, limit_ms=3000, kind="read.register")
    assert named(judged(deciding(3000, notes=notes))) is None
    assert named(judged(deciding(4000, notes=notes))) == (Diagnosis.TRANSACTION_TIMEOUT, Grade.CERTAIN)


def test_a_command_without_a_limit_may_take_for_ever() -> None:
    assert named(judged(deciding(LONG_MS, notes=deciding_since(100, limit_ms=0)))) is None


def test_the_policys_limit_counts_where_the_page_names_none() -> None:
    looks = deciding(4000, notes=deciding_since(100, limit_ms=0))
    verdicts = judged(looks, replace(PATIENCE, transaction_ms=2000))
    assert named(verdicts) == (Diagnosis.TRANSACTION_TIMEOUT, Grade.CERTAIN)


def test_reported_progress_begins_the_time_anew() -> None:
    looks = [
        replace(look, notes=deciding_since(100, progress_ms=max(100, look.at_ms - 500)))
        for look in deciding(LONG_MS)
    ]
    assert named(judged(looks)) is None


def test_a_commands_thread_that_is_not_let_uses_up_no_time() -> None:
    looks = [replace(look, deciding=traces.unlet(look.at_ms)) for look in deciding(LONG_MS)]
    assert named(judged(looks)) is None


def test_a_command_that_waits_for_a_disk_is_not_over_its_time() -> None:
    assert named(judged(deciding(LONG_MS, deciding=traces.ON_DISK))) is None


def test_a_command_behind_a_silent_loop_is_not_judged() -> None:
    assert named(judged([replace(look, loop_age_ms=400, loop=None) for look in deciding(LONG_MS)])) is None


def test_a_command_whose_thread_nobody_could_look_at_is_given_longer_and_is_only_likely() -> None:
    assert named(judged(deciding(2500, deciding=None))) is None
    assert named(judged(deciding(4000, deciding=None))) == (Diagnosis.TRANSACTION_TIMEOUT, Grade.LIKELY)


def test_the_time_that_we_slept_is_no_time_of_the_command() -> None:
    looks = [look for look in deciding(1900) if not 500 < look.at_ms < 1400]
    assert named(judged(looks)) is None


# DEADLOCK


def _waits(tid: int, lock: str, held_by: int) -> ThreadStack:
    names = (("lock_name", f"'{lock}'"), ("held_by", f"'{held_by}'"))
    return ThreadStack(tid, f"t{tid}", False, False, (StackFrame("wait_for_lock", "locks.py", 1, names),))


RING = (_waits(DECIDER, "a", 11), _waits(11, "b", DECIDER))


def test_a_command_in_a_ring_of_locks_is_a_deadlock_and_blamed() -> None:
    told = [StacksSampled(at_ns_of(at), 1, RING) for at in (400, 600)]
    verdict = red(heard(deciding(1000, deciding=traces.LOCKED), told))
    assert verdict is not None
    assert (verdict.diagnosis, verdict.grade, verdict.blamed) == (
        Diagnosis.DEADLOCK,
        Grade.CERTAIN,
        ("c1",),
    )


def test_a_silent_loop_in_a_ring_of_locks_is_a_deadlock() -> None:
    ring = (_waits(1, "a", 11), _waits(11, "b", 1))
    told = [StacksSampled(at_ns_of(at), 1, ring) for at in (1350, 1400)]
    looks = WELL + silent(1000, 900, Look(0, loop=traces.LOCKED))
    assert named(heard(looks, told)) == (Diagnosis.DEADLOCK, Grade.CERTAIN)


def test_one_look_at_a_ring_is_none() -> None:
    told = [StacksSampled(at_ns_of(400), 1, RING)]
    assert named(heard(deciding(1000, deciding=traces.LOCKED), told)) is None


def test_a_ring_that_hurts_nobody_is_only_told() -> None:
    ring = (_waits(21, "a", 22), _waits(22, "b", 21))
    told = [StacksSampled(at_ns_of(at), 1, ring) for at in range(0, 5000, 200)]
    verdicts = heard(well(5000), told)
    assert named(verdicts) is None
    assert verdicts[-1].colour is Colour.YELLOW


def test_waiting_for_one_who_works_is_no_ring() -> None:
    told = [StacksSampled(at_ns_of(at), 1, RING[:1]) for at in (400, 600)]
    assert named(heard(deciding(1000, deciding=traces.LOCKED), told)) is None


# NO_PROGRESS


def _claims(until_ms: int, answered: int, committed: int | None) -> list[Look]:
    return [
        Look(at, answered_seq=answered, witness_seq=committed, submitted=at, completed=at)
        for at in range(0, until_ms, 100)
    ]


def test_a_core_that_answers_and_commits_nothing_makes_no_progress() -> None:
    assert named(judged(_claims(4000, 7, 5))) == (Diagnosis.NO_PROGRESS, Grade.LIKELY)


@pytest.mark.parametrize("committed", [7, 9])
def test_what_is_committed_may_be_answered(committed: int) -> None:
    assert named(judged(_claims(LONG_MS, 7, committed))) is None


def test_before_the_first_commit_of_a_life_an_old_answer_may_be_given_again() -> None:
    assert named(judged(_claims(LONG_MS, 7, None))) is None


def test_a_core_whose_own_head_is_behind_its_answers_makes_no_progress() -> None:
    told = [
        Probed(at_ns_of(at), 1, at_ns_of(at - 50), answered=True, epoch=4, seq=5) for at in (500, 1500, 2500)
    ]
    assert named(heard(_claims(4000, 7, None), told)) == (Diagnosis.NO_PROGRESS, Grade.LIKELY)


def test_a_page_read_in_the_middle_is_no_lie() -> None:
    looks = [replace(look, witness_seq=6 + look.at_ms // 1000 % 2) for look in _claims(LONG_MS, 7, 6)]
    assert named(judged(looks)) is None


def _unanswered(until_ms: int) -> list[Probed]:
    return [Probed(at_ns_of(at), 1, at_ns_of(at - 900), answered=False) for at in range(1000, until_ms, 1000)]


def test_a_core_that_turns_and_answers_no_probe_makes_no_progress() -> None:
    assert named(heard(well(5000), _unanswered(5000))) == (Diagnosis.NO_PROGRESS, Grade.LIKELY)


def test_probes_of_a_core_that_is_stopped_now_and_then_are_not_counted_together() -> None:
    looks = [
        replace(look, state="T", loop=traces.STOPPED) if look.at_ms % 1000 in {800, 900} else look
        for look in well(LONG_MS)
    ]
    assert named(heard(looks, _unanswered(LONG_MS))) is None


def test_a_loaded_core_that_completes_something_may_leave_probes_unanswered() -> None:
    looks = [replace(look, submitted=99, completed=look.at_ms // 500) for look in well(LONG_MS)]
    assert named(heard(looks, _unanswered(LONG_MS))) is None


def test_a_probe_that_is_answered_now_and_then_is_enough() -> None:
    answered = [
        Probed(at_ns_of(at), 1, at_ns_of(at - 10), answered=True) for at in range(1500, LONG_MS, 2000)
    ]
    assert named(heard(well(LONG_MS), [*_unanswered(LONG_MS), *answered])) is None
