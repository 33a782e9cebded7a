"""What a guard does by itself in each mode, what a person's word changes, and what is done when nobody comes."""

import dataclasses
import json

import pytest

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.actions import AlertStage
from hardcore.model.phases import Face, HAState, Phase
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.policy import Policy, in_full
from tests.unit.recovery.play import Play, S, a_page, drained, fall_silent, kinds, look, proven, raised

WATCHING = ("assist", "observe")


def _reads(play: Play, **changed: object) -> list[orders.Action]:
    policy = dataclasses.replace(play.manager.policy, **changed)  # type: ignore[arg-type]  # names of settings
    return play.tell(seen.PolicyRead(play.now_ns, json.dumps(in_full(policy))))


def _stages(play: Play) -> list[AlertStage]:
    return [one.stage for one in play.ordered if isinstance(one, orders.Alert)]


@pytest.mark.parametrize("mode", WATCHING)
def test_a_guard_that_watches_starts_what_is_wanted(mode: str) -> None:
    assert kinds(Play(Policy(mode=mode)).begin().ordered) == ["Spawn"]


@pytest.mark.parametrize("mode", WATCHING)
def test_a_core_that_is_gone_is_left_to_a_person(mode: str) -> None:
    play = Play(Policy(mode=mode)).begin().running()
    given = play.die()
    assert "Spawn" not in kinds(given)
    assert "TakeEvidence" in kinds(given)
    told = play.manager.reading()
    assert (told.phase, told.state, told.face) == (Phase.FATAL, HAState.MANUAL_INTERVENTION, Face.REFUSE)
    assert (play.closed().diagnosis, play.closed().outcome) == (Diagnosis.KILLED_FROM_OUTSIDE, "assist")
    assert kinds(play.ask(seen.Verb.RESUME))[-1] == "Spawn"


@pytest.mark.parametrize("mode", WATCHING)
def test_a_core_that_hangs_is_not_touched_until_a_person_says_so(mode: str) -> None:
    play = Play(Policy(mode=mode)).begin().running()
    fall_silent(play, 0, 4000)
    assert not {"Kill", "Terminate", "SetSafe"} & set(kinds(play.ordered))
    assert not any(isinstance(one, orders.TakeEvidence) and one.stop for one in play.ordered)
    assert play.manager.reading().state is HAState.MANUAL_INTERVENTION
    given = play.ask(seen.Verb.RESUME)
    assert [one.stop for one in given if isinstance(one, orders.TakeEvidence)] == [True]
    assert play.phase is Phase.SNAPSHOT_LIVE
    play.ring()
    play.die()
    play.ready(5).ring()
    closed = [one.incident for one in play.ordered if isinstance(one, orders.CloseIncident)]
    assert [one.outcome for one in closed] == ["recovered"]


def test_a_restart_of_a_core_that_hangs_takes_its_evidence_too() -> None:
    play = Play(Policy(mode="assist")).begin().running()
    fall_silent(play, 0, 4000)
    assert kinds(play.ask(seen.Verb.RESTART))[-1] == "TakeEvidence"


def test_a_hang_that_ends_by_itself_is_told_as_one_that_nothing_was_done_about() -> None:
    play = Play(Policy(mode="assist", clean_after_ms=1000)).begin().running()
    fall_silent(play, 0, 4000)
    for _ in range(15):
        look(play, 0)
    assert play.closed().outcome == "assist"
    assert _stages(play) == [AlertStage.OPENED, AlertStage.WAITS, AlertStage.CLOSED]
    assert play.manager.reading().needs_ns is None


def test_who_only_observes_tells_nobody() -> None:
    play = Play(Policy(mode="observe")).begin().running()
    fall_silent(play, 0, 4000)
    play.die()
    assert _stages(play) == []


def test_what_was_begun_is_carried_through_when_the_mode_changes() -> None:
    play = Play().begin().running()
    fall_silent(play, 0, 1800)
    assert play.phase is Phase.SNAPSHOT_LIVE
    _reads(play, mode="observe")
    assert kinds(play.ring()) == ["Kill"]  # a core that was stopped for it can't be let go on
    assert "Spawn" not in kinds(play.die())
    assert play.manager.reading().face is Face.REFUSE


def test_a_core_that_was_left_is_replaced_once_the_mode_is_act_again() -> None:
    play = Play(Policy(mode="observe")).begin().running()
    play.die()
    _reads(play, mode="act")
    assert kinds(play.ring())[-1] == "Spawn"


def test_a_start_that_waits_is_not_made_when_the_mode_forbids_it() -> None:
    play = Play(Policy(restart_delay_ms=500)).begin().running()
    play.die()
    assert play.phase is Phase.BACKOFF
    _reads(play, mode="assist")
    assert (play.phase, play.closed().outcome) == (Phase.FATAL, "assist")


def test_a_switch_that_a_person_asked_for_is_done_in_any_mode() -> None:
    play = Play(Policy(mode="observe")).begin().running().spared()
    assert kinds(play.ask(seen.Verb.RESTART)) == ["Drain"]
    assert "Promote" in kinds(drained(play))
    raised(play, 5)
    proven(play, 5)
    assert play.phase is Phase.PROBATION


# ---- a policy that is read anew ----


def test_a_budget_keeps_its_deaths_over_a_new_policy() -> None:
    play = Play().begin().running()
    play.die()
    play.running(5)
    _reads(play, max_restart_count=1)
    play.die()
    assert play.phase is Phase.FATAL


def test_a_deadline_that_runs_keeps_its_time_and_the_next_has_the_new_one() -> None:
    play = Play(Policy(startup_timeout_ms=9000)).begin()
    due_ns = play.manager.next_deadline_ns()
    _reads(play, startup_timeout_ms=3000)
    assert play.manager.next_deadline_ns() == due_ns
    play.ready().ring()
    play.die()
    assert play.phase is Phase.STARTING
    assert play.manager.next_deadline_ns() == play.now_ns + 3 * S


def test_patience_follows_the_policy_while_the_core_is_watched() -> None:
    play = Play().begin().running()
    _reads(play, confirm_hang_ms=60_000)
    fall_silent(play, 0, 4000)
    assert play.phase is Phase.SUSPECT


# ---- nobody comes ----


def _damned(*words: str, mode: str = "act") -> Play:
    policy = Policy(
        mode=mode, max_restart_count=1, slow_retry_sec=0, await_operator_sec=30, on_await_timeout=words
    )
    play = Play(policy).begin().running()
    play.die()
    if mode == "act":
        play.running(5).die()
    assert play.phase is Phase.FATAL
    return play


def test_when_nobody_comes_that_is_said_once() -> None:
    play = _damned("SEND_ALERT")
    assert kinds(play.ring()) == ["Alert"]
    assert _stages(play)[-1] is AlertStage.OVERDUE
    assert play.manager.next_deadline_ns() is None


@pytest.mark.parametrize("mode", ["act", "assist"])
def test_when_nobody_comes_the_policy_may_have_another_try_made(mode: str) -> None:
    assert kinds(_damned("REBOOT_PROCESS", mode=mode).ring()) == ["Spawn"]


def test_when_nobody_comes_the_policy_may_have_reads_served() -> None:
    play = _damned("SAFE_MODE_ENTER")
    play.ring()
    assert play.spawned().safe is Diagnosis.CRASH_LOOP


def test_who_only_observes_does_nothing_when_nobody_comes() -> None:
    assert kinds(_damned("REBOOT_PROCESS", mode="observe").ring()) == []


def test_a_core_that_hangs_and_is_nobodys_is_ended_when_the_policy_says_so() -> None:
    words = ("SEND_ALERT", "REBOOT_PROCESS")
    play = Play(Policy(mode="assist", await_operator_sec=1, on_await_timeout=words)).begin().running()
    fall_silent(play, 0, 2800)
    assert play.phase is Phase.SNAPSHOT_LIVE


def test_a_service_that_was_shut_down_begins_again_only_at_a_persons_word() -> None:
    play = Play(Policy(mode="assist", await_operator_sec=1, on_await_timeout=("SHUTDOWN",))).begin().running()
    fall_silent(play, 0, 3000)
    assert play.phase is Phase.STOPPING
    play.die(seen.Exit(code=0))
    assert play.manager.reading().state is HAState.MANUAL_INTERVENTION
    _reads(play, mode="act")
    assert play.manager.reading().face is Face.REFUSE
    assert play.manager.next_deadline_ns() is None
    assert kinds(play.ask(seen.Verb.RESUME))[-1] == "Spawn"
    assert play.closed().outcome == "manual"


# ---- what is told of the state ----


def test_each_change_of_the_state_has_the_reason_that_it_began_with() -> None:
    play = Play().begin().running().spared()
    play.die()
    raised(play, 5)
    proven(play, 5)
    play.ring()
    told = play.manager.reading().history
    assert [(one.before, one.after) for one in told] == [
        (HAState.STARTING, HAState.OPERATIONAL),
        (HAState.OPERATIONAL, HAState.RECOVERY),
        (HAState.RECOVERY, HAState.OPERATIONAL),
    ]
    assert "SIGKILL" in told[1].reason
    assert all(one.reason for one in told)


def test_the_history_is_bounded() -> None:
    play = Play().begin().running()
    for on in (True, False) * 150:
        play.ask(seen.Verb.SAFE_ON if on else seen.Verb.SAFE_OFF)
        play.tell(seen.SafeSwitched(play.now_ns, 1, on, done=True))
    assert len(play.manager.reading().history) == 256


def test_an_alert_names_its_incident_and_is_closed_once_with_the_outage() -> None:
    play = Play().begin().running()
    play.die()
    play.ready(5)
    play.now_ns += S
    play.tell(seen.FirstServed(play.now_ns, 5))
    play.ring()
    opened, closed = (one for one in play.ordered if isinstance(one, orders.Alert))
    assert (opened.incident, opened.stage) == ("i1", AlertStage.OPENED)
    assert (closed.incident, closed.stage, closed.outcome) == ("i1", AlertStage.CLOSED, "recovered")
    assert closed.outage_ms == 1000


def test_a_guard_says_how_long_nobody_watched() -> None:
    play = Play()
    page = a_page(4, seq=9)
    play.tell(seen.SentinelBegan(play.now_ns, adoptable=page, unwatched_ns=700_000_000, found_frozen=True))
    told = play.closed()
    assert told.diagnosis is Diagnosis.SENTINEL_LOST
    assert dict(told.timeline)["fault"] == play.now_ns - 700_000_000
    why = {one.why for one in told.evidence}
    assert {"nobody watched for 700 ms", "the guard before stood still, and was ended"} <= why
    assert kinds(play.ordered).count("CloseIncident") == 1


def test_a_guard_that_was_lost_while_no_core_was_there_is_told_of_too() -> None:
    play = Play()
    play.tell(seen.SentinelBegan(play.now_ns, unwatched_ns=4 * S, found_frozen=True))
    assert play.phase is Phase.ADOPTING
    play.die()
    play.ready(5)
    play.ring()
    incident = play.closed()
    assert (incident.diagnosis, incident.outcome) == (Diagnosis.SENTINEL_LOST, "recovered")
    assert any("4000 ms" in one.why for one in incident.evidence)


def test_what_the_policy_has_shut_down_stays_so_when_its_guard_is_lost() -> None:
    play = Play()
    play.tell(seen.SentinelBegan(play.now_ns, unwatched_ns=S, shut=Diagnosis.STORE_CORRUPT))
    assert play.phase is Phase.FATAL


def test_a_guard_that_ended_itself_for_a_drill_is_told_as_a_drill_and_to_nobody() -> None:
    play = Play()
    play.tell(seen.SentinelBegan(play.now_ns, adoptable=a_page(4, seq=9), unwatched_ns=S, drilled=True))
    assert play.closed().drill == "sentinel"
    assert "Alert" not in kinds(play.ordered)
    assert play.manager.reading().drill_ns is None
