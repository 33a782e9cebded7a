"""How a service comes back from what a person was waited for: tries by itself, a person's word, another guard."""

import dataclasses
import json

import pytest

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.actions import AlertStage
from hardcore.model.looks import ProcessSample
from hardcore.model.phases import HAState, Phase
from hardcore.model.recorder import Beats, LifeState, Threads, Witness
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.policy import Policy, Word, in_full
from tests.unit.recovery.play import MS, Play, S, a_page, drained, fall_silent, kinds, look, proven

LOOP, CRASHED = Diagnosis.CRASH_LOOP, Diagnosis.CRASHED
READ = frozenset({Word.SEND_ALERT, Word.SAFE_MODE_ENTER})
TIRED = Policy(max_restart_count=1, actions={LOOP: READ})
SHUT = Policy(max_restart_count=1, actions={LOOP: frozenset({Word.SEND_ALERT, Word.SHUTDOWN})})


def _reader(policy: Policy = TIRED) -> Play:
    """Two cores have died, and one that reads only serves."""
    play = Play(policy).begin().running()
    play.die()
    play.running(5).die()
    assert play.spawned().safe is LOOP
    _serves(play)
    return play


def _serves(play: Play) -> None:
    """The core that was started to read only is ready, and lasts."""
    play.tell(seen.CoreSpawned(play.now_ns, play.life, 9))
    play.tell(seen.CoreReady(play.now_ns, play.life, 5, seen.Proof("none", 0, 7, "h7")))
    play.ring()
    assert (play.phase, play.manager.reading().state) == (Phase.RUNNING, HAState.SAFE_MODE)


def _tries(play: Play) -> int:
    """The next try to write is made; return after how many seconds."""
    began_ns = play.now_ns
    while "Terminate" not in kinds(play.ordered[-1:]):
        play.ring()
    return (play.now_ns - began_ns) // S


def _reads(play: Play, **changed: object) -> None:
    policy = dataclasses.replace(play.manager.policy, **changed)  # type: ignore[arg-type]  # names of settings
    play.tell(seen.PolicyRead(play.now_ns, json.dumps(in_full(policy))))


def _holds_too_much(play: Play, seconds: int) -> None:
    for _ in range(seconds * 2):
        play.now_ns += 500 * MS
        beats = Beats(loop_ns=play.now_ns, thread_ns=play.now_ns, state=LifeState.READY)
        process = ProcessSample("S", 1, 4 << 30, 3)
        play.tell(seen.Sampled(play.now_ns, play.life, beats, Threads(1, 3, 2), process))
        due_ns = play.manager.next_deadline_ns()
        if due_ns is not None and due_ns <= play.now_ns:
            play.manager.handle_deadline(play.now_ns)
            play.tell()


# ---- reading only is left by itself ----


def test_a_reader_that_the_policy_started_makes_room_after_a_minute() -> None:
    play = _reader()
    assert 55 <= _tries(play) <= 60
    play.die(seen.Exit(code=0))
    assert play.spawned().safe is None


def test_a_try_to_write_that_fails_returns_to_reading_and_the_next_one_comes_later() -> None:
    play = _reader()
    _tries(play)
    play.die(seen.Exit(code=0))
    play.die(seen.Exit(code=1))
    assert (play.spawned().safe, play.phase) == (LOOP, Phase.STARTING)
    _serves(play)
    assert 110 <= _tries(play) <= 120


def test_a_core_that_dies_in_the_probation_of_such_a_try_is_followed_by_a_reader() -> None:
    play = _reader()
    _tries(play)
    play.die(seen.Exit(code=0))
    play.ready(6).die()
    assert play.spawned().safe is LOOP


def test_a_try_that_finds_the_ledger_damaged_is_the_last_one() -> None:
    play = _reader()
    _tries(play)
    play.die(seen.Exit(code=0))
    play.tell(seen.CoreSpawned(play.now_ns, play.life, 9))
    play.tell(seen.GatewayWitnessed(play.now_ns, Witness(8, 5, "h8")))
    proven(play, 6)
    play.die()
    assert play.spawned().safe is Diagnosis.STORE_CORRUPT
    play.tell(seen.CoreSpawned(play.now_ns, play.life, 9))
    play.tell(seen.CoreReady(play.now_ns, play.life, 6, seen.Proof("none", 0, 7, "h7")))
    assert play.manager.reading().state is HAState.MANUAL_INTERVENTION
    before = kinds(play.ordered).count("Terminate")
    while play.manager.next_deadline_ns() is not None:
        play.ring()
    assert kinds(play.ordered).count("Terminate") == before


def test_the_pauses_between_tries_grow_no_longer_than_the_policy_says() -> None:
    play, pauses = _reader(), []
    for _ in range(5):
        pauses.append(_tries(play))
        play.die(seen.Exit(code=0))
        play.die(seen.Exit(code=1))
        _serves(play)
    assert pauses == sorted(pauses)
    assert pauses[-1] <= Policy().slow_retry_sec


def test_after_a_try_that_came_off_the_next_trouble_begins_with_the_first_pause() -> None:
    play = _reader()
    _tries(play)
    play.die(seen.Exit(code=0))
    play.running(6)
    assert play.manager.reading().state is HAState.OPERATIONAL
    play.die()
    assert play.spawned().safe is None, "the budget is asked, not the old trouble"
    play.running(7).die()
    _serves(play)
    assert _tries(play) <= 60


def test_where_the_policy_never_tries_again_a_reader_stays() -> None:
    play = _reader(dataclasses.replace(TIRED, slow_retry_sec=0, on_await_timeout=()))
    while play.manager.next_deadline_ns() is not None:
        play.ring()
    assert "Terminate" not in kinds(play.ordered)


def test_when_nobody_comes_a_core_that_only_reads_is_changed_where_the_policy_says_so() -> None:
    policy = dataclasses.replace(
        TIRED, slow_retry_sec=0, await_operator_sec=30, on_await_timeout=("REBOOT_PROCESS",)
    )
    assert _tries(_reader(policy)) <= 30


# ---- what the policy has shut down ----


def test_a_service_that_the_policy_shut_down_is_written_down_as_such() -> None:
    play = Play(SHUT).begin().running()
    play.die()
    play.running(5).die()
    kept = [one for one in play.ordered if isinstance(one, orders.KeepBudget)]
    assert (kept[-1].shut, play.phase) == (LOOP, Phase.FATAL)
    play.ask(seen.Verb.RESUME)
    assert play.ordered[-2] == orders.KeepBudget(())


@pytest.mark.parametrize("found", ["nothing", "leftovers", "a core that serves"])
def test_no_guard_begins_again_what_the_policy_of_one_before_has_shut_down(found: str) -> None:
    play = Play(SHUT)
    page = a_page(4, seq=9) if found == "a core that serves" else None
    play.tell(seen.SentinelBegan(play.now_ns, found == "leftovers", adoptable=page, shut=LOOP))
    if found != "nothing":
        assert {"Terminate", "KillLeftovers"} & set(kinds(play.ordered))
        play.die(seen.Exit(code=0))
    assert (play.phase, play.manager.reading().state) == (Phase.FATAL, HAState.MANUAL_INTERVENTION)
    assert play.manager.reading().waits_for == LOOP
    assert AlertStage.WAITS in [one.stage for one in play.ordered if isinstance(one, orders.Alert)]
    assert "Spawn" not in kinds(play.ordered)
    _reads(play, mode="assist")
    _reads(play, mode="act")
    assert "Spawn" not in kinds(play.ordered)
    play.ask(seen.Verb.RESUME)
    assert kinds(play.ordered)[-1] == "Spawn"


def test_a_stop_takes_back_that_the_policy_shut_the_service_down() -> None:
    play = Play(SHUT)
    play.tell(seen.SentinelBegan(play.now_ns, shut=LOOP))
    assert orders.KeepBudget(()) in play.ask(seen.Verb.STOP)


def test_a_person_who_speaks_while_the_policy_shuts_down_is_heard() -> None:
    policy = Policy(mode="assist", await_operator_sec=1, on_await_timeout=("SHUTDOWN",))
    play = Play(policy).begin().running()
    fall_silent(play, 0, 3000)
    assert play.phase is Phase.STOPPING
    play.ask(seen.Verb.RESTART_HARD)
    assert kinds(play.die())[-1] == "Spawn"


# ---- modes ----


def test_a_dead_core_that_no_try_would_help_is_not_started_because_the_mode_is_another() -> None:
    never = {CRASHED: frozenset({Word.SEND_ALERT})}
    play = Play(Policy(mode="assist", actions=never)).begin().running()
    play.die(seen.Exit(signal=11))
    _reads(play, mode="act")
    assert (play.phase, play.manager.next_deadline_ns()) != (Phase.STARTING, play.now_ns)
    assert kinds(play.ordered).count("Spawn") == 1


def test_a_dead_core_is_followed_by_a_reader_once_the_mode_allows_one() -> None:
    play = Play(Policy(mode="assist", actions={CRASHED: READ})).begin().running()
    play.die(seen.Exit(signal=11))
    _reads(play, mode="act")
    assert play.spawned().safe is CRASHED


@pytest.mark.parametrize("mode", ["assist", "observe"])
def test_a_switch_that_waits_for_calm_is_not_done_once_the_mode_leaves_it_to_a_person(mode: str) -> None:
    play = Play().begin().running()
    _holds_too_much(play, 15)
    assert play.manager.reading().switch_waits
    _reads(play, mode=mode)
    play.spared()
    play.tell(seen.GatewayCounted(play.now_ns, 0, 0, 0))
    look(play, 0)
    assert "Drain" not in kinds(play.ordered)
    assert not play.manager.reading().switch_waits


def test_a_resume_in_a_mode_that_only_tells_does_the_switch_that_was_left_out() -> None:
    play = Play(Policy(mode="assist")).begin().running()
    _holds_too_much(play, 15)
    play.spared()
    assert "Drain" not in kinds(play.ordered)
    play.ask(seen.Verb.RESUME)
    assert kinds(play.ordered)[-1] == "Drain"
    drained(play)
    assert kinds(play.ordered)[-1] == "Promote"


def test_a_core_that_holds_too_much_in_its_probation_is_changed_once_it_is_proven() -> None:
    play = Play(Policy(probation_ms=20_000)).begin().ready()
    _holds_too_much(play, 15)
    assert not play.manager.reading().switch_waits
    _holds_too_much(play, 10)
    assert play.manager.reading().switch_waits


def test_whoever_was_told_only_that_somebody_is_needed_is_told_that_it_is_over() -> None:
    quiet = {Diagnosis.NO_PROGRESS: frozenset({Word.REBOOT_PROCESS})}
    policy = Policy(
        mode="assist", clean_after_ms=1000, actions={**dict.fromkeys(Diagnosis, frozenset()), **quiet}
    )
    play = Play(policy).begin().running()
    fall_silent(play, 0, 4000)
    for _ in range(15):
        look(play, 0)
    stages = [one.stage for one in play.ordered if isinstance(one, orders.Alert)]
    assert stages == [AlertStage.WAITS, AlertStage.CLOSED]
