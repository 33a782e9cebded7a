from itertools import product

import pytest

from hardcore.model.phases import (
    LIVING,
    SERVING,
    Face,
    HAState,
    Phase,
    StartCause,
    Wanted,
    face,
    ha_state,
    stage,
)
from hardcore.model.verdicts import Diagnosis

UP, DOWN = Wanted.UP, Wanted.DOWN
FIRST, PLANNED, UNPLANNED = StartCause.FIRST, StartCause.PLANNED, StartCause.UNPLANNED


def _state(phase: Phase, cause: StartCause = UNPLANNED, *, yellow: bool = False) -> HAState:
    return ha_state(phase, UP, cause, yellow=yellow)


def test_nobody_is_held_for_a_service_that_is_being_stopped() -> None:
    assert {face(phase, DOWN) for phase in Phase} & {Face.HOLD} == set()


def test_nobody_is_held_when_nobody_knows_for_how_long() -> None:
    assert {phase for phase in Phase if face(phase, UP) is Face.REFUSE} == {Phase.FATAL, Phase.UNKILLABLE}


def test_requests_are_held_on_every_way_to_a_serving_core() -> None:
    way = set(Phase) - SERVING - {Phase.FATAL, Phase.UNKILLABLE}
    assert {face(phase, UP) for phase in way} == {Face.HOLD}


def test_a_serving_phase_has_a_process() -> None:
    assert SERVING <= LIVING


def test_a_first_start_is_starting_and_not_a_recovery() -> None:
    for phase in (Phase.STARTING, Phase.PROVING, Phase.BACKOFF):
        assert _state(phase, FIRST) is HAState.STARTING
        assert _state(phase, UNPLANNED) is HAState.RECOVERY


@pytest.mark.parametrize("phase", sorted(SERVING))
def test_a_core_that_serves_reads_only_is_safe_mode_and_a_damaged_ledger_needs_a_person(phase: Phase) -> None:
    for cause, yellow in product(StartCause, (False, True)):
        full = ha_state(phase, UP, cause, yellow=yellow, safe=Diagnosis.DISK_FULL)
        assert full is HAState.SAFE_MODE
        damaged = ha_state(phase, UP, cause, yellow=yellow, safe=Diagnosis.STORE_CORRUPT)
        assert damaged is HAState.MANUAL_INTERVENTION


def test_safe_mode_is_only_said_while_somebody_serves() -> None:
    for phase in set(Phase) - SERVING:
        assert ha_state(phase, UP, UNPLANNED, yellow=False, safe=Diagnosis.DISK_FULL) is _state(phase)


def test_probation_after_a_death_is_recovery_and_else_operational() -> None:
    assert _state(Phase.PROBATION, UNPLANNED) is HAState.RECOVERY
    assert _state(Phase.PROBATION, PLANNED) is HAState.OPERATIONAL
    assert _state(Phase.PROBATION, FIRST) is HAState.OPERATIONAL


def test_a_suspicion_is_not_shown_before_it_has_lasted() -> None:
    assert _state(Phase.SUSPECT) is HAState.OPERATIONAL
    assert _state(Phase.SUSPECT, yellow=True) is HAState.DEGRADED


def test_only_people_end_what_only_people_can_end() -> None:
    manual = {phase for phase in Phase if _state(phase) is HAState.MANUAL_INTERVENTION}
    assert manual == {Phase.FATAL, Phase.UNKILLABLE}


@pytest.mark.parametrize(("phase", "cause", "yellow"), list(product(Phase, StartCause, (True, False))))
def test_what_nobody_wants_is_a_shutdown(phase: Phase, cause: StartCause, yellow: bool) -> None:
    assert ha_state(phase, DOWN, cause, yellow=yellow) is HAState.SHUTDOWN


def test_no_stage_is_shown_while_a_core_serves() -> None:
    assert {stage(phase) for phase in SERVING} == {None}


def test_the_stages_only_grow_on_the_way_of_a_recovery() -> None:
    way = [Phase.SNAPSHOT_LIVE, Phase.KILLING, Phase.BACKOFF, Phase.STARTING, Phase.PROVING]
    shown = [stage(phase) or 0 for phase in way]
    assert shown == sorted(shown)
    assert shown[-1] == 4
