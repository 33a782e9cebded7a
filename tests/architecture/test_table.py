"""The table of transitions is total, has no dead end, and its picture is in step.

That no row is dead is shown where the worlds are: `tests/simulation/test_rows.py`.
"""

from itertools import product

import pytest

from hardcore.model import observations as seen
from hardcore.model.looks import DiskFacts
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
from hardcore.model.recorder import Witness
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.failover import FailoverManager
from hardcore.recovery.plan import limit_ns
from hardcore.recovery.policy import DEFAULT_ACTIONS, Policy
from hardcore.recovery.transitions import ON_ENTRY, TABLE, Step, Trigger, step
from tests.architecture.draw_table import PAGE, draw

#: Phases that may last for ever: what people want, or what only people can end.
MAY_LAST = frozenset({Phase.STOPPED, Phase.RUNNING, Phase.SUSPECT, Phase.FATAL})


@pytest.mark.parametrize(("phase", "trigger"), list(product(Phase, Trigger)))
def test_every_cell_of_the_table_is_a_row_or_stay(phase: Phase, trigger: Trigger) -> None:
    row = step(phase, trigger)
    if row is not None:
        after, steps = row
        assert isinstance(after, Phase)
        assert all(isinstance(one, Step) for one in steps)


def test_every_phase_has_rows() -> None:
    assert set(TABLE) == set(Phase)


def test_every_phase_is_reached_from_stopped() -> None:
    reached, new = {Phase.STOPPED}, {Phase.STOPPED}
    while new:
        new = {after for before in new for after, _ in TABLE[before].values()} - reached
        reached |= new
    assert reached == set(Phase)


@pytest.mark.parametrize("phase", Phase)
def test_every_phase_can_be_left(phase: Phase) -> None:
    assert any(after is not phase for after, _ in TABLE[phase].values())


@pytest.mark.parametrize("phase", Phase)
def test_a_phase_ends_by_itself_or_is_meant_to_last(phase: Phase) -> None:
    timed = limit_ns(Policy(), phase, 1, Diagnosis.CRASHED) is not None
    assert timed != (phase in MAY_LAST)
    if timed:
        assert (Trigger.LASTED if phase is Phase.PROBATION else Trigger.DEADLINE) in TABLE[phase]


def test_only_a_spent_budget_ends_fatal_by_itself() -> None:
    assert limit_ns(Policy(), Phase.FATAL, 0, Diagnosis.CRASH_LOOP) == Policy().slow_retry_sec * 1_000_000_000
    assert limit_ns(Policy(slow_retry_sec=0), Phase.FATAL, 0, Diagnosis.CRASH_LOOP) is None
    assert limit_ns(Policy(), Phase.FATAL, 0, Diagnosis.STORE_CORRUPT) is None


def test_a_core_is_started_only_from_a_phase_without_a_process() -> None:
    starts = {before for before, rows in TABLE.items() for _, steps in rows.values() if Step.SPAWN in steps}
    assert starts.isdisjoint(LIVING)


def test_a_spare_takes_over_only_where_nobody_else_can_be_the_core_or_is_left_behind() -> None:
    for phase, rows in TABLE.items():
        for trigger, (after, steps) in rows.items():
            promotes = {Step.PROMOTE, Step.PROMOTE_BRIEFLY} & set(steps)
            assert bool(promotes) == (after is Phase.SWITCHING), f"{phase} x {trigger}"
            if promotes:
                alone = phase not in LIVING
                assert alone or steps.index(Step.LEAVE_BEHIND) == 0, f"{phase} x {trigger}"
                assert alone or trigger in {Trigger.DRAINED, Trigger.SPARE_READY}


def test_a_core_is_left_behind_only_drained_or_killed() -> None:
    left = {
        (phase, trigger)
        for phase, rows in TABLE.items()
        for trigger, (_, steps) in rows.items()
        if Step.LEAVE_BEHIND in steps
    }
    assert left == {(Phase.DRAINING, Trigger.DRAINED), (Phase.UNKILLABLE, Trigger.SPARE_READY)}


def test_who_was_left_behind_is_told_to_leave_before_the_way_goes_on_without_a_spare() -> None:
    for trigger, (after, steps) in TABLE[Phase.BACKOFF].items():
        if after in {Phase.STARTING, Phase.FATAL}:
            assert Step.RETIRE in steps, trigger


def test_whether_a_core_is_stuck_is_asked_before_any_other_is_started() -> None:
    asked = ON_ENTRY[Phase.BACKOFF]
    starts = {t for t, (_, steps) in TABLE[Phase.BACKOFF].items() if _begins(steps)} & set(asked)
    assert all(asked.index(Trigger.STUCK) < asked.index(trigger) for trigger in starts)


def _begins(steps: tuple[Step, ...]) -> bool:
    """Whether a core begins on the way."""
    return bool({Step.SPAWN, Step.SPAWN_READER, Step.PROMOTE} & set(steps))


def test_a_drained_core_is_ended_before_another_is_started_the_cold_way() -> None:
    cold = {after for after, steps in TABLE[Phase.DRAINING].values() if Step.PROMOTE not in steps}
    assert cold == {Phase.RUNNING, Phase.STOPPING, Phase.KILLING, Phase.BACKOFF}
    assert TABLE[Phase.DRAINING][Trigger.EXITED][0] is Phase.BACKOFF


def test_a_switch_begins_only_with_a_core_that_is_proven() -> None:
    assert {phase for phase in Phase if Trigger.SWITCH in TABLE[phase]} == {Phase.RUNNING, Phase.SUSPECT}


def test_no_spare_waits_where_somebody_may_put_another_ledger_in_place() -> None:
    for phase, rows in TABLE.items():
        for trigger, (after, steps) in rows.items():
            if phase is not after and (after is Phase.FATAL or Step.SPAWN_READER in steps):
                assert Step.DISMISS in steps, f"{phase} x {trigger}"


def test_a_phase_with_a_process_hears_of_its_end() -> None:
    assert all(Trigger.EXITED in TABLE[phase] for phase in LIVING)


def test_a_phase_in_which_a_process_may_be_in_the_making_hears_of_its_failure() -> None:
    possible = {Phase.STARTING, Phase.STOPPING, Phase.SNAPSHOT_LIVE, Phase.KILLING, Phase.UNKILLABLE}
    assert all(Trigger.SPAWN_FAILED in TABLE[phase] for phase in possible)


def test_only_a_core_that_is_ready_is_released_or_one_that_serves_again() -> None:
    releases = {t for rows in TABLE.values() for t, (_, steps) in rows.items() if Step.RELEASE in steps}
    assert releases == {Trigger.READY, Trigger.FOUND_SERVING, Trigger.FOUND_NEW}
    again = {(p, t) for p, rows in TABLE.items() for t, (_, s) in rows.items() if Step.RELEASE_AGAIN in s}
    assert again == {(Phase.DRAINING, Trigger.NOT_DRAINED)}


def test_every_way_into_serving_releases_a_core() -> None:
    for phase in set(Phase) - SERVING:
        for trigger, (after, steps) in TABLE[phase].items():
            if after in SERVING:
                assert {Step.RELEASE, Step.RELEASE_AGAIN} & set(steps), f"{phase} x {trigger}"


def test_a_living_core_is_killed_only_after_evidence_or_by_the_operators_word() -> None:
    kills = {(p, t) for p, rows in TABLE.items() for t, (_, steps) in rows.items() if Step.KILL in steps}
    for phase, trigger in kills:
        asked = trigger is Trigger.RESTART_HARD or phase is Phase.STOPPING
        told_before = phase in {Phase.SNAPSHOT_LIVE, Phase.KILLING, Phase.UNKILLABLE}
        killed_before = trigger is Trigger.STUCK
        served_nobody = phase is Phase.SWITCHING  # a spare that does not take over: the cold way is there
        assert asked or told_before or killed_before or served_nobody, f"{phase} x {trigger}"


def test_a_stop_is_obeyed_at_once_or_asked_about_before_the_next_start() -> None:
    for phase in Phase:
        obeyed = Trigger.STOP in TABLE[phase]
        leads_on = {after for after, _ in TABLE[phase].values()} - {phase}
        asked = all(
            Trigger.UNWANTED in ON_ENTRY.get(after, ()) or after is Phase.KILLING for after in leads_on
        )
        assert obeyed or asked, phase


def test_every_question_on_entering_a_phase_has_its_row() -> None:
    assert all(question in TABLE[phase] for phase, asked in ON_ENTRY.items() for question in asked)


def test_every_diagnosis_has_a_default_answer() -> None:
    assert set(DEFAULT_ACTIONS) == set(Diagnosis)
    assert all(DEFAULT_ACTIONS.values())


@pytest.mark.parametrize(("phase", "wanted"), list(product(Phase, Wanted)))
def test_every_reading_of_every_phase_has_an_answer(phase: Phase, wanted: Wanted) -> None:
    assert isinstance(face(phase, wanted), Face)
    assert stage(phase) in {None, 1, 2, 3, 4}
    for cause, yellow in product(StartCause, (False, True)):
        assert isinstance(ha_state(phase, wanted, cause, yellow=yellow), HAState)


def test_requests_are_forwarded_in_the_phases_that_serve_and_in_no_other() -> None:
    assert {phase for phase in Phase if face(phase, Wanted.UP) is Face.FORWARD} == SERVING


def test_what_nobody_wants_is_a_shutdown_in_every_phase() -> None:
    assert {ha_state(p, Wanted.DOWN, c, yellow=False) for p in Phase for c in StartCause} == {
        HAState.SHUTDOWN
    }


_NS = 1_000_000_000
_FACTS: tuple[seen.Observation, ...] = (
    seen.SentinelBegan(_NS),
    seen.SentinelBegan(_NS, leftovers=True),
    *(seen.OperatorAsked(_NS, verb) for verb in seen.Verb),
    *(seen.DrillStarted(_NS, "crash", life) for life in (0, 1)),
    seen.GatewayHolding(_NS),
    seen.FirstServed(_NS, 1),
    seen.RequestsSettled(_NS, "i", ()),
    *(seen.CoreSpawned(_NS, life, 1) for life in (0, 1)),
    *(seen.SpawnFailed(_NS, life, "none") for life in (0, 1)),
    *(seen.CoreExited(_NS, life, seen.Exit(code=1), None) for life in (0, 1)),
    *(seen.EvidenceTaken(_NS, life, complete=True, page=None) for life in (0, 1)),
    seen.FenceBlocked(_NS, 1),
    seen.TermReceived(_NS, 1, 1),
    seen.StartExtended(_NS, 1, _NS),
    seen.EpochRaised(_NS, 1, 2),
    *(seen.CoreReady(_NS, life, 2, seen.Proof(kind, 0, 0, "")) for life, kind in ((1, "chain"), (2, "none"))),
    seen.CoreExited(_NS, 1, seen.Exit(code=73), None),
    seen.LedgerAudited(_NS, 1, None, "not whole"),
    *(seen.StoreTold(_NS, 1, fault) for fault in (seen.StoreFault.FULL, seen.StoreFault.OK)),
    *(seen.SafeSwitched(_NS, 1, on, done=True) for on in (True, False)),
    seen.Surveyed(_NS, 1, DiskFacts(0, read_only=True, write_ns=None)),
    seen.StacksSampled(_NS, 1, ()),
    seen.OperatorAsked(_NS, seen.Verb.RESTART_HARD, image=True),
    seen.SpareReady(_NS, 1, "b", 4),
    seen.PromoteRefused(_NS, 1, "no"),
    *(seen.Drained(_NS, 1, done) for done in (True, False)),
    seen.GatewayWitnessed(_NS, Witness(1, 1, "h")),
)


@pytest.mark.parametrize("first", _FACTS, ids=lambda fact: type(fact).__name__)
def test_no_two_facts_in_any_order_surprise_a_guard_that_is_up(first: seen.Observation) -> None:
    for second, third in product(_FACTS, _FACTS):
        manager = FailoverManager(Policy(), Wanted.UP, lambda: "i", lambda: 0.5)
        for fact in (seen.SentinelBegan(_NS), first, second, third):
            if not isinstance(fact, seen.SentinelBegan) or manager.reading().phase is Phase.STOPPED:
                manager.receive(fact)


def test_the_page_about_the_table_is_drawn_from_it() -> None:
    assert PAGE.read_text(encoding="utf-8") == draw(), "python -m tests.architecture.draw_table"
