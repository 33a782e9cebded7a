"""Who comes after a core: the spare after a death, after a kill that does not work, and because a person asked."""

from typing import TypeVar

import pytest

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.phases import HAState, Phase
from hardcore.model.recorder import Threads, Witness
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.policy import Policy
from hardcore.recovery.succession import DRAINS_MAX
from tests.unit.recovery.play import MS, Play, S, a_page, deciding, drained, kinds, look, proven, raised

T = TypeVar("T")
RESTART = seen.Verb.RESTART


def _running(policy: Policy | None = None) -> Play:
    return Play(policy or Policy()).begin().running(4)


def _spared() -> Play:
    return _running().spared()


def _kill_in_vain(play: Play, state: str = "S") -> Phase:
    """The core was killed and is still there; what happens then is up to the spare, which is in this `state`."""
    play.ask(seen.Verb.RESTART_HARD)
    return _wait(play, state)


def _wait(play: Play, state: str = "S") -> Phase:
    """Let the present phase's time be over; the spare was just looked at."""
    play.now_ns = play.manager.next_deadline_ns() or 0
    play.glance(state=state)
    play.ring()
    return play.phase


def _last(play: Play, kind: type[T]) -> T:
    return [order for order in play.ordered if isinstance(order, kind)][-1]


# After a death.


def test_a_death_is_answered_with_the_spare_that_waits() -> None:
    play = _spared()
    waiting = play.spare
    given = play.die(page=a_page(4, seq=9))
    assert play.phase is Phase.SWITCHING
    assert orders.Promote(waiting, 4, (Witness(9, 4, "h9"),)) in given
    assert "Spawn" not in kinds(given)


@pytest.mark.parametrize(("silent_ms", "state"), [(2000, "S"), (0, "T")])
def test_a_sick_spare_is_never_promoted(silent_ms: int, state: str) -> None:
    play = _spared()
    play.now_ns += silent_ms * MS
    play.glance(silent_ms, state)
    assert "Spawn" in kinds(play.die())


def test_a_spare_that_nobody_has_seen_for_long_is_never_promoted() -> None:
    play = _spared()
    play.now_ns += 3 * S
    assert "Spawn" in kinds(play.die())


def test_the_commands_of_a_core_that_crashed_are_suspects_for_the_spare_too() -> None:
    play = _spared()
    play.die(seen.Exit(signal=11), a_page(4, deciding("k1"), seq=9))
    raised(play, 5)
    proven(play, 5, 9)
    assert _last(play, orders.Release).suspects == ("k1",)


@pytest.mark.parametrize("how", ["refused", "died", "silent"])
def test_a_spare_that_does_not_take_over_is_followed_by_a_cold_start_at_once(how: str) -> None:
    play = _spared()
    play.die(page=a_page(4, seq=9))
    if how == "died":
        given = play.die(seen.Exit(code=1))
    else:
        given = (
            play.tell(seen.PromoteRefused(play.now_ns, play.life, "no")) if how == "refused" else play.ring()
        )
        assert kinds(given) == ["Kill"]
        given = play.die()
    assert "Spawn" in kinds(given), "without a pause: it was never the core"
    assert play.phase is Phase.STARTING


def test_a_spare_that_dies_at_its_proof_costs_no_pause_either() -> None:
    play = _spared()
    play.die(page=a_page(4, seq=9))
    raised(play, 5)
    assert "Spawn" in kinds(play.die(seen.Exit(code=1)))


def test_a_broken_ledger_that_a_spare_has_met_is_the_ledger_of_the_core_that_serves() -> None:
    play = _spared()
    core, fault = play.life, "event 70 does not follow"
    given = play.tell(seen.LedgerAudited(play.now_ns, play.spare, None, fault))
    assert orders.SetSafe(core, True, Diagnosis.STORE_CORRUPT) in given
    assert play.manager.reading().audit == seen.LedgerAudited(play.now_ns, core, None, fault)
    play.tell(seen.CoreExited(play.now_ns, play.spare, seen.Exit(code=65), None))
    assert (play.phase, play.life) == (Phase.RUNNING, core)


def test_a_spare_proves_nothing_whole() -> None:
    play = _spared()
    assert play.tell(seen.LedgerAudited(play.now_ns, play.spare, 7)) == []
    assert play.manager.reading().audit is None


def test_the_death_of_a_spare_never_counts_on_the_core() -> None:
    play = _spared()
    before = play.manager.reading().deaths
    play.tell(seen.CoreExited(play.now_ns, play.spare, seen.Exit(signal=11), None))
    assert (play.phase, play.manager.reading().deaths) == (Phase.RUNNING, before)
    assert play.spare == 0


def test_a_new_spare_is_started_only_beside_a_proven_core() -> None:
    play = _spared()
    play.die(page=a_page(4, seq=9))
    raised(play, 5)
    proven(play, 5, 9)
    assert "SpawnSpare" not in kinds(look(play, 0))
    play.ring()
    assert play.phase is Phase.RUNNING
    assert "SpawnSpare" in kinds(look(play, 0))


def test_a_spare_that_was_told_to_end_before_it_was_there_is_told_again() -> None:
    play = _running()
    look(play, 0)
    play.tell(seen.Surveyed(play.now_ns, play.life, free_bytes=8 << 30))
    look(play, 0)
    waiting = play.spare
    assert orders.Kill(waiting) in play.ask(seen.Verb.STOP)
    assert play.tell(seen.CoreSpawned(play.now_ns, waiting, 10)) == [orders.Kill(waiting)]


def test_a_stop_ends_the_spare_too() -> None:
    play = _spared()
    waiting = play.spare
    given = play.ask(seen.Verb.STOP)
    assert orders.Kill(waiting) in given
    assert kinds(play.die(seen.Exit(code=0)))[-1] == "Halt"


def test_no_spare_waits_while_a_person_may_put_another_ledger_in_place() -> None:
    play = _spared()
    play.ask(seen.Verb.RESTART_HARD)
    play.tell(seen.CoreExited(play.now_ns, play.life, seen.Exit(signal=9), a_page(4, seq=9)))
    play.die(seen.Exit(code=65), a_page(0, words="STORE_CORRUPT"))
    assert play.spawned().safe is Diagnosis.STORE_CORRUPT
    play.tell(seen.CoreReady(play.now_ns, play.life, 4, seen.Proof("none", 0, 9, "")))
    play.ring()
    play.tell(seen.Surveyed(play.now_ns, play.life, free_bytes=8 << 30))
    assert "SpawnSpare" not in kinds(look(play, 0))


# Because a person asked.


def test_a_switch_drains_the_old_core_before_the_spare_takes_over() -> None:
    play = _spared()
    old, waiting = play.life, play.spare
    assert kinds(play.ask(RESTART)) == ["Drain"]
    assert play.phase is Phase.DRAINING
    assert next(x for x in drained(play) if isinstance(x, orders.Promote)).life == waiting
    raised(play, 5)
    assert orders.Terminate(old) in proven(play, 5)
    assert play.manager.reading().state is HAState.OPERATIONAL


def test_a_drained_core_that_does_not_leave_is_killed_and_again() -> None:
    play = _spared()
    old = play.life
    play.ask(RESTART)
    drained(play)
    raised(play, 5)
    proven(play, 5)
    play.ring()
    assert play.ring() == [orders.Kill(old)]
    assert play.ring() == [orders.Kill(old)]
    assert play.manager.reading().state is HAState.DEGRADED
    play.tell(seen.CoreExited(play.now_ns, old, seen.Exit(signal=9), None))
    assert play.manager.reading().behind is None


def test_a_core_that_can_not_be_drained_serves_again_and_is_asked_again() -> None:
    play = _spared()
    play.ask(RESTART)
    given = drained(play, done=False)
    assert kinds(given) == ["Release"]
    assert play.phase is Phase.RUNNING
    for _ in range(DRAINS_MAX - 1):
        play.glance()
        due_ns = play.manager.next_deadline_ns()
        assert due_ns is not None
        play.now_ns = due_ns
        play.glance()
        assert kinds(play.ring()) == ["Drain"]
        drained(play, done=False)
    assert not play.manager.reading().switch_waits
    assert _last(play, orders.Alert).diagnosis is Diagnosis.PLANNED_SWITCH
    assert play.closed().id == "i1", "one wish is one incident"
    assert kinds(play.ordered).count("CloseIncident") == 1
    assert any("given up: it takes too long" in fact.why for fact in play.closed().evidence)


def test_a_death_between_two_tries_to_drain_is_a_story_of_its_own() -> None:
    play = _spared()
    play.ask(RESTART)
    drained(play, done=False)
    play.die(page=a_page(4, seq=9))
    assert (play.closed().id, play.closed().deaths) == ("i1", ())
    assert play.manager.reading().incident == "i2"


def test_the_outage_of_a_second_try_to_drain_begins_with_it() -> None:
    play = _spared()
    play.ask(RESTART)
    drained(play, done=False)
    began_ns = play.now_ns
    play.now_ns += S
    play.glance()
    play.ring()
    drained(play)
    raised(play, 5)
    proven(play, 5)
    play.ring()
    assert play.closed().id == "i1"
    assert dict(play.closed().timeline)["fault"] == began_ns + S


def test_what_is_known_of_a_core_outlives_a_drain_in_vain() -> None:
    play = _spared()
    play.tell(seen.LedgerAudited(play.now_ns, play.life, 7))
    play.ask(RESTART)
    drained(play, done=False)
    assert play.manager.reading().audit is not None


def test_what_a_core_says_of_its_store_while_it_is_drained_is_heard_when_it_serves_again() -> None:
    play = _spared()
    play.ask(RESTART)
    play.tell(seen.StoreTold(play.now_ns, play.life, seen.StoreFault.FULL))
    assert play.phase is Phase.DRAINING
    drained(play, done=False)
    assert play.manager.reading().safe is Diagnosis.DISK_FULL


def test_a_core_that_dies_of_the_drain_is_an_unplanned_death() -> None:
    play = _spared()
    play.ask(RESTART)
    given = play.die(seen.Exit(signal=11), a_page(4, seq=9))
    assert play.phase is Phase.SWITCHING
    assert "KeepBudget" in kinds(given)
    assert not play.manager.reading().planned


def test_a_core_that_reads_only_for_a_while_is_not_changed_meanwhile() -> None:
    play = _running()
    play.tell(seen.Surveyed(play.now_ns, play.life, free_bytes=8 << 30))
    play.ask(RESTART)
    play.tell(seen.StoreTold(play.now_ns, play.life, seen.StoreFault.FULL))
    play.spared()
    assert "Drain" not in kinds(play.ordered)
    play.tell(seen.StoreTold(play.now_ns, play.life, seen.StoreFault.OK))
    assert "Drain" in kinds(look(play, 0))


def test_a_core_that_was_drained_without_a_spare_left_is_stopped_before_another_begins() -> None:
    play = _spared()
    play.ask(RESTART)
    play.tell(seen.CoreExited(play.now_ns, play.spare, seen.Exit(signal=9), None))
    assert kinds(drained(play)) == ["Terminate"]
    assert play.phase is Phase.STOPPING


def test_a_drain_that_is_never_answered_ends_with_a_stop() -> None:
    play = _spared()
    play.ask(RESTART)
    assert kinds(play.ring()) == ["Terminate"]


def test_a_switch_waits_for_the_probation() -> None:
    play = _spared()
    play.die(page=a_page(4, seq=9))
    raised(play, 5)
    proven(play, 5, 9)
    assert play.ask(RESTART) == []
    assert play.manager.reading().switch_waits
    play.ring()
    play.spared()
    assert play.phase is Phase.DRAINING


def test_a_core_that_died_meanwhile_has_fulfilled_the_wish() -> None:
    play = _running()
    play.tell(seen.Surveyed(play.now_ns, play.life, free_bytes=8 << 30))
    play.ask(RESTART)
    assert play.manager.reading().switch_waits
    play.die(page=a_page(4, seq=9))
    assert not play.manager.reading().switch_waits


def test_an_update_waits_for_a_spare_that_runs_the_new_code() -> None:
    play = _spared()
    old = play.spare
    assert play.ask(RESTART, build="b2") == [orders.Kill(old)]
    play.tell(seen.CoreExited(play.now_ns, old, seen.Exit(signal=9), None))
    play.spared("b2")
    assert play.phase is Phase.DRAINING


def test_an_old_spare_that_took_over_meanwhile_has_not_fulfilled_an_update() -> None:
    play = _running()
    play.tell(seen.Surveyed(play.now_ns, play.life, free_bytes=8 << 30))
    look(play, 0)
    play.ask(RESTART, build="b2")
    at = play.now_ns
    play.tell(seen.CoreSpawned(at, play.spare, 10))
    play.die(page=a_page(4, seq=9))
    assert play.phase is Phase.STARTING
    assert not play.manager.reading().switch_waits, "a cold start runs what lies on the disk"


def test_code_that_does_not_start_is_never_switched_to() -> None:
    play = _spared()
    old = play.spare
    play.ask(RESTART, build="bad")
    play.tell(seen.CoreExited(play.now_ns, old, seen.Exit(signal=9), None))
    look(play, 0)
    play.tell(seen.CoreExited(play.now_ns, play.spare, seen.Exit(code=1), a_page(0, words="BUG")))
    assert play.phase is Phase.RUNNING
    assert not play.manager.reading().switch_waits
    assert _last(play, orders.Alert).diagnosis is Diagnosis.PLANNED_SWITCH


def test_without_a_spare_to_come_a_restart_is_done_the_cold_way() -> None:
    play = _running(Policy(spare=False))
    assert kinds(play.ask(RESTART)) == ["Terminate"]


def test_a_core_that_reads_only_is_changed_the_cold_way() -> None:
    play = _spared()
    play.tell(seen.StoreTold(play.now_ns, play.life, seen.StoreFault.FULL))
    assert "Terminate" in kinds(play.ask(RESTART))


def test_a_stop_in_the_middle_of_a_switch_leaves_nobody() -> None:
    play = _spared()
    old = play.life
    play.ask(RESTART)
    drained(play)
    new = play.life
    assert orders.Terminate(new) in play.ask(seen.Verb.STOP)
    assert kinds(play.die(seen.Exit(signal=15)))[-2:] == ["Kill", "Halt"]
    assert orders.Kill(old) in play.ordered


# After a kill that does not work.


def test_a_core_that_does_not_die_is_left_behind_the_fence_of_the_spare() -> None:
    play = _spared()
    assert _kill_in_vain(play, "T") is Phase.UNKILLABLE, "the spare was stopped"
    assert _wait(play) is Phase.SWITCHING
    assert _last(play, orders.Promote).busy_ms is not None


def _behind() -> Play:
    """A spare is taking over beside a core that does not die."""
    play = _spared()
    assert _kill_in_vain(play) is Phase.SWITCHING
    return play


def test_a_spare_that_can_not_fence_off_a_stuck_core_gives_the_place_back() -> None:
    play = _behind()
    old = play.manager.reading().behind
    play.die(seen.Exit(code=69), a_page(0, words="DB_LOCKED"))
    assert (play.phase, play.life) == (Phase.UNKILLABLE, old)
    assert "Spawn" not in kinds(play.ordered[-4:])
    play.die()
    assert play.phase is Phase.STARTING


def test_a_stuck_core_that_is_the_core_again_still_has_its_suspects() -> None:
    play = _spared()
    for _ in range(60):
        if play.phase is Phase.SNAPSHOT_LIVE:
            break
        look(play, play.now_ns // MS)  # no beat has ever been heard of since
    play.tell(seen.EvidenceTaken(play.now_ns, play.life, complete=False, page=None))
    assert _wait(play) is Phase.SWITCHING
    play.die(seen.Exit(code=69), a_page(0, words="DB_LOCKED"))
    play.die(page=a_page(4, deciding("k1"), seq=9))
    raised(play, 5)
    proven(play, 5, 9)
    assert _last(play, orders.Release).suspects == ("k1",)


def test_once_a_stuck_core_is_fenced_off_its_successor_may_have_one_too() -> None:
    play = _behind()
    raised(play, 5)
    play.die(seen.Exit(signal=11))
    assert play.phase is Phase.STARTING


def test_it_is_degraded_while_a_stuck_core_lives_behind_the_fence_and_it_is_killed_again() -> None:
    play = _behind()
    old = play.manager.reading().behind
    raised(play, 5)
    proven(play, 5)
    play.ring()
    assert play.manager.reading().state is HAState.DEGRADED
    assert orders.Kill(old or 0) in play.ring()


def test_no_spare_takes_over_beside_a_core_that_is_still_being_made() -> None:
    play = _spared()
    play.glance(state="T")
    assert "Spawn" in kinds(play.die())
    assert _kill_in_vain(play) is Phase.UNKILLABLE
    assert kinds(play.tell(seen.CoreSpawned(play.now_ns, play.life, 12))) == ["Kill"]


def test_a_tick_shows_what_a_core_that_never_dies_has_committed() -> None:
    play = _spared()
    tick = seen.Sampled(play.now_ns + MS, play.life, None, Threads(), None, witness=Witness(33, 4, "h33"))
    play.tell(tick)
    _kill_in_vain(play)
    assert Witness(33, 4, "h33") in _last(play, orders.Promote).witnesses
