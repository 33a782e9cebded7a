"""The manager fact by fact, where a rule needs its very moment; the worlds of `tests/simulation` do the rest."""

import pytest
from msgspec import structs

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.actions import AlertStage
from hardcore.model.phases import Face, HAState, Phase, Wanted
from hardcore.model.recorder import (
    Beats,
    Threads,
    Witness,
)
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.drill import DRILL_GRACE_NS, PendingDrill
from hardcore.recovery.policy import Policy, Word
from tests.unit.recovery.play import MS, PROOF, Play, S, a_page, deciding, kinds

# The way of a core.


def test_a_first_start_raises_whatever_stands_in_the_store() -> None:
    assert Play().begin().spawned() == orders.Spawn(1, None, ())


def test_the_successor_of_a_core_that_said_its_epoch_expects_it_and_its_witness() -> None:
    play = Play().begin().running(epoch=4)
    play.die(page=a_page(4, seq=9))
    assert play.spawned() == orders.Spawn(2, 4, (Witness(9, 4, "h9"),))


def test_a_core_that_may_have_raised_the_epoch_unseen_makes_it_uncertain() -> None:
    play = Play().begin().running(epoch=4)
    play.die(page=a_page(4))
    play.die()
    play.ring()
    assert play.spawned().expected_epoch is None


def test_a_page_that_a_new_guard_found_is_a_witness_and_no_certainty_of_the_epoch() -> None:
    play = Play()
    play.tell(seen.SentinelBegan(play.now_ns, page=a_page(6, seq=9)))
    play.die()
    assert play.spawned() == orders.Spawn(1, None, (Witness(9, 6, "h9"),))


def test_a_guard_that_finds_its_predecessor_and_the_core_gone_tells_it_as_an_incident() -> None:
    play = Play()
    play.tell(seen.SentinelBegan(play.now_ns, page=a_page(6, seq=9)))
    play.die()
    play.running(7)
    assert play.closed().diagnosis is Diagnosis.SENTINEL_LOST


def test_what_an_earlier_guard_left_is_ended_before_anything_is_started() -> None:
    play = Play()
    assert play.tell(seen.SentinelBegan(play.now_ns, leftovers=True))[-1] == orders.KillLeftovers()
    assert play.phase is Phase.ADOPTING
    assert "Spawn" in kinds(play.die(page=a_page(6)))


def test_what_an_earlier_guard_left_is_killed_again_until_it_is_gone_whenever_that_is() -> None:
    play = Play()
    play.tell(seen.SentinelBegan(play.now_ns, leftovers=True))
    assert kinds(play.ring()) == ["Alert"]
    assert play.phase is Phase.UNKILLABLE
    for given in (play.ring(), play.ring(), play.ask(seen.Verb.RESUME), play.ask(seen.Verb.RESTART_HARD)):
        assert kinds(given) == ["KillLeftovers"]
    assert kinds(play.die()) == ["Spawn"]


def test_a_guard_that_nobody_wants_ends_at_once() -> None:
    assert kinds(Play(wanted=Wanted.DOWN).begin().ordered) == ["Halt"]


def test_a_ready_core_is_released_with_its_epoch() -> None:
    play = Play().begin().ready(epoch=4)
    assert play.ordered[-1] == orders.Release(1, 4, (), None)
    assert play.manager.reading().epoch == 4


def test_facts_about_another_life_are_dropped() -> None:
    play = Play().begin()
    play.tell(seen.CoreExited(play.now_ns, 7, seen.Exit(code=1), None), seen.SpawnFailed(play.now_ns, 0, ""))
    assert play.phase is Phase.STARTING


def test_a_core_that_asks_for_more_time_gets_it() -> None:
    play = Play().begin()
    play.tell(seen.StartExtended(play.now_ns + 15 * S, 1, 10 * S))
    assert play.manager.next_deadline_ns() == play.now_ns + 25 * S


def test_no_core_gets_more_than_another_start_at_once() -> None:
    play = Play().begin()
    play.tell(seen.StartExtended(play.now_ns, 1, 10**18))
    assert play.manager.next_deadline_ns() == play.now_ns + play.policy.startup_timeout_ms * MS


def test_a_boot_that_slept_with_the_machine_begins_its_time_anew() -> None:
    play = Play().begin()
    late_ns = play.now_ns + 3600 * S
    play.manager.handle_deadline(late_ns)
    assert play.phase is Phase.STARTING
    assert play.manager.next_deadline_ns() == late_ns + play.policy.startup_timeout_ms * MS


# Orders to a core that is not there yet.


@pytest.mark.parametrize(("verb", "order"), [(seen.Verb.STOP, "Terminate"), (seen.Verb.RESTART_HARD, "Kill")])
def test_a_core_is_told_again_when_it_is_there(verb: seen.Verb, order: str) -> None:
    play = Play().begin()
    assert kinds(play.ask(verb)) == [order]
    assert kinds(play.tell(seen.CoreSpawned(play.now_ns, 1, 9))) == [order]


def test_a_birth_that_fails_is_an_end_in_whatever_phase_it_is_told() -> None:
    for rings in range(3):  # STOPPING, KILLING, UNKILLABLE
        play = Play().begin()
        play.ask(seen.Verb.STOP)
        for _ in range(rings):
            play.ring()
        play.tell(seen.SpawnFailed(play.now_ns, 1, "no more processes"))
        assert play.phase is Phase.STOPPED


def test_a_birth_that_fails_after_its_whole_time_is_an_end_too() -> None:
    play = Play().begin()
    assert "TakeEvidence" in kinds(play.ring())
    play.tell(seen.SpawnFailed(play.now_ns, 1, "no more processes"))
    assert play.phase is Phase.BACKOFF


# Deaths.


def test_a_proven_core_is_replaced_at_once() -> None:
    play = Play().begin().running()
    assert kinds(play.die())[-1] == "Spawn"


def test_the_successor_of_a_core_on_probation_waits() -> None:
    play = Play().begin().ready()
    play.die()
    assert play.phase is Phase.BACKOFF
    assert play.manager.next_deadline_ns() == play.now_ns + play.policy.backoff_initial_ms * MS


def test_a_spent_budget_ends_fatal_with_an_alert_and_the_incident_closed() -> None:
    play = Play(Policy(max_restart_count=1)).begin().running()
    play.die()
    given = play.running(5).die()
    assert play.phase is Phase.FATAL
    waits = [order for order in given if isinstance(order, orders.Alert) and order.stage is AlertStage.WAITS]
    assert [order.diagnosis for order in waits] == [Diagnosis.CRASH_LOOP]
    assert play.closed().outcome == "manual"
    assert play.manager.reading().face is Face.REFUSE


def test_deaths_on_disk_are_on_the_budget_of_a_new_guard() -> None:
    play = Play(Policy(max_restart_count=1), deaths_ns=(99 * S,)).begin().running()
    play.die()
    assert play.phase is Phase.FATAL


def test_a_stamp_from_another_boot_ages_from_the_beginning_of_the_guard() -> None:
    play = Play(Policy(max_restart_count=1), deaths_ns=(10**18,)).begin().running()
    play.now_ns += 61 * S
    play.die()
    assert play.phase is Phase.STARTING


def test_deaths_that_have_left_the_window_are_not_shown() -> None:
    play = Play().begin().running()
    play.die()
    play.running(5)
    assert play.manager.reading().deaths == 1
    beats = Beats(loop_ns=play.now_ns + 70 * S, thread_ns=play.now_ns + 70 * S)
    play.tell(seen.Sampled(play.now_ns + 70 * S, play.life, beats, Threads(), None))
    assert play.manager.reading().deaths == 0


@pytest.mark.parametrize(
    ("code", "diagnosis"),
    [(65, Diagnosis.STORE_CORRUPT), (73, Diagnosis.DISK_FULL), (78, Diagnosis.CONFIG_INVALID)],
)
def test_what_a_restart_would_not_heal_waits_for_the_operator(code: int, diagnosis: Diagnosis) -> None:
    waits = frozenset({Word.SEND_ALERT, Word.AWAIT_OPERATOR})
    play = Play(Policy(actions={diagnosis: waits})).begin()
    play.die(seen.Exit(code=code), a_page(0, words=diagnosis))
    assert play.phase is Phase.FATAL
    assert "Spawn" not in kinds(play.ring())  # nobody comes
    assert play.manager.next_deadline_ns() is None
    assert play.closed().diagnosis is diagnosis
    assert kinds(play.ask(seen.Verb.RESUME))[-1] == "Spawn"


def test_resume_empties_the_budget() -> None:
    play = Play(Policy(max_restart_count=1)).begin().running()
    play.die()
    play.running(5).die()
    assert orders.KeepBudget(()) in play.ask(seen.Verb.RESUME)


def test_an_incident_is_announced_as_the_policy_says() -> None:
    alerts = [order for order in Play().begin().running().die() if isinstance(order, orders.Alert)]
    assert [order.diagnosis for order in alerts] == [Diagnosis.KILLED_FROM_OUTSIDE]
    quiet = Policy(actions={Diagnosis.KILLED_FROM_OUTSIDE: frozenset({Word.REBOOT_PROCESS})})
    assert "Alert" not in kinds(Play(quiet).begin().running().die())


def test_a_drill_is_neither_announced_nor_counted() -> None:
    play = Play().begin().running()
    play.tell(seen.DrillStarted(play.now_ns, "crash", play.life))
    assert {"Alert", "KeepBudget"}.isdisjoint(kinds(play.die(seen.Exit(signal=6))))
    play.running(5)
    assert play.closed().drill == "crash"


def test_a_drill_without_effect_excuses_no_later_death() -> None:
    play = Play().begin().running()
    play.tell(seen.DrillStarted(play.now_ns, "crash", play.life))
    play.now_ns += DRILL_GRACE_NS + 1
    assert "KeepBudget" in kinds(play.die())


@pytest.mark.parametrize("fault", ["leak", "stall"])
def test_a_drill_that_shows_slowly_excuses_nothing_but_what_it_leads_to(fault: str) -> None:
    play = Play().begin().running()
    play.tell(seen.DrillStarted(play.now_ns, fault, play.life))
    assert "KeepBudget" in kinds(play.die())


def test_a_drill_that_shows_slowly_is_waited_for_and_its_effect_is_its_own_once() -> None:
    pending = PendingDrill()
    pending.start(seen.DrillStarted(0, "leak", 1))
    late_ns = DRILL_GRACE_NS * 10
    assert pending.take(Diagnosis.CRASHED, late_ns) is None
    assert pending.explains(Diagnosis.LEAK, late_ns)
    assert [pending.take(Diagnosis.LEAK, late_ns) for _ in range(2)] == ["leak", None]


def test_a_drill_is_one_lifes() -> None:
    play = Play().begin().running()
    play.die()
    play.tell(seen.DrillStarted(play.now_ns, "crash", play.life))
    assert "KeepBudget" in kinds(play.tell(seen.SpawnFailed(play.now_ns, play.life, "none")))


def test_a_drill_that_another_core_was_told_is_nobodys() -> None:
    play = Play().begin().running()
    told = play.life
    play.die()
    play.running(5)
    play.tell(seen.DrillStarted(play.now_ns, "crash", told))
    assert play.manager.reading().drill_ns is None
    assert "KeepBudget" in kinds(play.die())


# Suspects.


def test_the_next_release_names_the_suspects_of_a_crash() -> None:
    play = Play().begin().running()
    play.die(seen.Exit(signal=11), a_page(4, deciding("k")))
    play.ready(5)
    assert play.ordered[-1] == orders.Release(2, 5, ("k",), "i1")


def test_each_life_answers_for_its_own_end() -> None:
    play = Play().begin().running()
    play.die(seen.Exit(signal=9), a_page(4, deciding("innocent")))
    play.ready(5).die(seen.Exit(signal=11), a_page(5, deciding("guilty")))
    play.ring()
    play.ready(6)
    assert play.ordered[-1] == orders.Release(3, 6, ("guilty",), "i2")


def test_a_crash_instead_of_leaving_makes_suspects_too() -> None:
    play = Play(Policy(spare=False)).begin().running()
    play.ask(seen.Verb.RESTART)
    play.die(seen.Exit(signal=11), a_page(4, deciding("k")))
    play.ready(5)
    assert play.ordered[-1] == orders.Release(2, 5, ("k",), "i1")


def test_a_planned_incident_that_a_death_overtook_keeps_its_suspects() -> None:
    play = Play(Policy(spare=False)).begin().running()
    play.ask(seen.Verb.RESTART)
    play.die(seen.Exit(signal=11), a_page(4, deciding("k")))
    play.die(seen.Exit(code=1))
    play.ring()
    play.ready(5)
    assert play.ordered[-1] == orders.Release(3, 5, ("k",), "i1")


# Evidence.


def test_a_living_core_is_killed_after_its_evidence() -> None:
    play = Play().begin()
    (evidence,) = [order for order in play.ring() if isinstance(order, orders.TakeEvidence)]
    assert evidence.living
    taken = seen.EvidenceTaken(play.now_ns, 1, complete=True, page=None, steps=(("frozen", play.now_ns),))
    assert play.tell(taken) == [orders.Kill(1)]


def test_evidence_that_does_not_come_delays_the_kill_no_further_than_its_time() -> None:
    play = Play().begin()
    play.ring()
    assert play.ring() == [orders.Kill(1)]


def test_a_policy_without_evidence_kills_at_once() -> None:
    actions = {Diagnosis.STARTUP_FAILED: frozenset({Word.SEND_ALERT, Word.REBOOT_PROCESS})}
    given = Play(Policy(actions=actions)).begin().ring()
    assert "TakeEvidence" not in kinds(given)
    assert given[-1] == orders.Kill(1)


# The operator.


@pytest.mark.parametrize("rings", range(4))
def test_a_stop_is_never_forgotten_on_the_way(rings: int) -> None:
    play = Play().begin()
    for _ in range(rings):  # STARTING, SNAPSHOT_LIVE, KILLING, UNKILLABLE
        play.ring()
    play.ask(seen.Verb.STOP)
    play.die()
    assert play.phase is Phase.STOPPED
    assert play.manager.reading().state is HAState.SHUTDOWN
    assert isinstance(play.ordered[-1], orders.Halt)


def test_nothing_is_started_while_a_core_may_live() -> None:
    play = Play().begin().running()
    play.ask(seen.Verb.RESTART_HARD)
    play.ring()
    assert play.phase is Phase.UNKILLABLE
    for verb in (seen.Verb.RESTART, seen.Verb.RESTART_HARD, seen.Verb.RESUME):
        assert "Spawn" not in kinds(play.ask(verb))
    assert "Spawn" in kinds(play.die())


def test_a_planned_restart_is_an_incident_and_not_on_the_budget() -> None:
    play = Play(Policy(spare=False)).begin().running()
    play.ask(seen.Verb.RESTART, "new release")
    assert "KeepBudget" not in kinds(play.die(seen.Exit(code=0)))
    play.running(5)
    told = play.closed()
    assert (told.planned, told.diagnosis, told.reason) == (True, Diagnosis.OPERATOR, "new release")
    assert told.outcome == "recovered"


def test_every_change_of_phase_has_a_reason() -> None:
    play = Play(Policy(spare=False)).begin().running()
    play.ask(seen.Verb.RESTART)
    play.die(seen.Exit(code=0))
    assert all(change.reason for change in play.manager.take_transitions())


# Incidents.


def test_an_incident_is_closed_once_when_its_core_has_lasted() -> None:
    play = Play().begin().running()
    play.die()
    play.running(5)
    told = play.closed()
    assert (told.id, told.outcome, told.next_epoch, told.proof) == ("i1", "recovered", 5, PROOF)
    assert sum(isinstance(order, orders.CloseIncident) for order in play.ordered) == 1


def test_several_deaths_before_one_core_serves_are_one_incident() -> None:
    play = Play().begin().running()
    play.die(seen.Exit(signal=11))
    play.die(seen.Exit(signal=9))
    play.ring()
    play.running(6)
    told = play.closed()
    assert [death.diagnosis for death in told.deaths] == [Diagnosis.CRASHED, Diagnosis.KILLED_FROM_OUTSIDE]
    assert told.diagnosis is Diagnosis.CRASHED


def test_a_death_after_a_core_has_served_is_another_incident() -> None:
    play = Play().begin().running()
    play.die(seen.Exit(signal=11))
    play.ready(5).die(seen.Exit(signal=9))
    first = play.closed()
    assert (first.diagnosis, first.outcome) == (Diagnosis.CRASHED, "recovered")
    play.ring()
    play.running(6)
    told = [order.incident for order in play.ordered if isinstance(order, orders.CloseIncident)]
    assert [incident.diagnosis for incident in told] == [Diagnosis.CRASHED, Diagnosis.KILLED_FROM_OUTSIDE]


def test_the_proof_of_an_idle_ledger_names_the_witness_that_its_core_was_given() -> None:
    play = Play().begin().running()
    play.die(seen.Exit(signal=9), a_page(4))
    play.running(5)
    witness = play.closed().witness
    assert witness is not None
    assert (witness.seq, witness.hash) == (PROOF.seq, PROOF.hash)


def test_a_core_that_was_silent_before_it_was_killed_is_told_from_its_last_beat() -> None:
    play = Play().begin().running()
    page = a_page(4)
    silent = structs.replace(page, beats=structs.replace(page.beats, loop_ns=play.now_ns - 9 * S))
    play.die(seen.Exit(signal=9), silent)
    play.running(5)
    steps = dict(play.closed().timeline)
    assert steps["fault"] == silent.beats.loop_ns


def test_the_proof_of_a_core_that_is_being_ended_counts_for_nothing() -> None:
    play = Play().begin()
    play.ask(seen.Verb.RESTART_HARD)
    play.tell(seen.CoreReady(play.now_ns, 1, 4, PROOF))
    play.ask(seen.Verb.STOP)
    play.die()
    assert (play.closed().outcome, play.closed().proof) == ("manual", None)


def test_what_became_of_the_requests_stays_with_an_incident_that_changes_its_name() -> None:
    play = Play(Policy(spare=False)).begin().running()
    play.ask(seen.Verb.RESTART)
    outcome = seen.RequestOutcome("POST", "/", "k", "replayed", 201, 5)
    play.tell(seen.RequestsSettled(play.now_ns, "i1", (outcome,)))
    play.die(seen.Exit(code=0))
    play.die(seen.Exit(code=1))
    play.ring()
    play.running(5)
    assert play.closed().requests == (outcome,)


def test_only_the_first_answer_of_the_serving_epoch_is_the_serving_step() -> None:
    play = Play().begin().running()
    play.die()
    play.ready(5)
    play.tell(seen.FirstServed(play.now_ns + 1, 4), seen.FirstServed(play.now_ns + 2, 5))
    play.ring()
    assert dict(play.closed().timeline)["serving"] == play.closed().timeline[0][1] + 2
