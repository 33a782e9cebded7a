"""Code that nobody has seen start never takes the place of a core that serves, unless a person insists."""

import pytest

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.phases import HAState, Phase
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.policy import Policy
from hardcore.recovery.spare import DEATHS_MAX, PAUSE_NS, QUIET_NS, Lack
from tests.unit.recovery.play import Play, S, a_page, drained, kinds, look, proven, raised

RESTART = seen.Verb.RESTART
SAID = "SyntaxError (limits.py, line 28)"


def _running(policy: Policy | None = None) -> Play:
    return Play(policy or Policy()).begin().running(4)


def _spared() -> Play:
    return _running().spared()


def _fails(play: Play) -> list[orders.Action]:
    """The spare that is being started ends, because of its code."""
    end = seen.CoreExited(play.now_ns, play.spare, seen.Exit(code=1), None, said=SAID)
    return play.tell(end)


def _waits(play: Play, build: str) -> list[orders.Action]:
    """The spare that is being started is ready."""
    at = play.now_ns
    given = play.tell(seen.CoreSpawned(at, play.spare, 10))
    given += play.glance()
    return given + play.tell(seen.SpareReady(at, play.spare, build, 4))


def _lost() -> Play:
    """Spares of the code on the disk have died again and again."""
    play = _spared()
    _fails(play)
    for _ in range(DEATHS_MAX):
        play.now_ns += PAUSE_NS
        look(play, 0)
        _fails(play)
    assert play.manager.reading().spare_lack is Lack.DIED
    return play


@pytest.mark.parametrize("serves", ["", "b1"])
@pytest.mark.parametrize("policy", [Policy(spare=False), Policy(spare_memory_mb=1 << 20), Policy()])
def test_an_update_is_tried_as_a_spare_also_where_none_is_kept(policy: Policy, serves: str) -> None:
    play = _running(policy)
    if not policy.spare or policy.spare_memory_mb > 1024:
        play.tell(seen.Surveyed(play.now_ns, play.life, free_bytes=8 << 30))
    assert kinds(play.ask(RESTART, build="bad", serves=serves)) == ["SpawnSpare"]
    _fails(play)
    told = play.manager.reading()
    assert (told.phase, told.switch_waits, told.switch_fault) == (
        Phase.RUNNING,
        False,
        SAID,
    )
    assert "Terminate" not in kinds(play.ordered)


def test_a_spare_for_one_wish_takes_over_where_none_is_kept() -> None:
    play = _running(Policy(spare=False))
    play.ask(RESTART, build="b2", serves="b1")
    _waits(play, "b2")
    assert play.phase is Phase.DRAINING
    drained(play)
    raised(play, 5)
    proven(play, 5)
    play.ring()
    assert "SpawnSpare" not in kinds(look(play, 0))


def test_a_spare_for_a_wish_that_is_over_is_ended_where_none_is_kept() -> None:
    play = _running(Policy(spare=False))
    play.ask(RESTART, build="b2", serves="b1")
    _waits(play, "b2")
    while play.manager.reading().switch_waits or play.phase is Phase.DRAINING:
        drained(play, done=False)
        play.now_ns += S
        play.glance()
        if play.manager.reading().switch_waits:
            play.ring()
    assert look(play, 0) == [orders.Kill(play.spare)]


def test_a_restart_with_the_code_that_serves_needs_no_try() -> None:
    play = _running(Policy(spare=False))
    assert kinds(play.ask(RESTART, build="b1", serves="b1")) == ["Terminate"]


def test_code_that_was_refused_is_refused_however_often_it_is_asked_for() -> None:
    play = _lost()
    for _ in range(3):
        assert kinds(play.ask(RESTART, build="bad", serves="b1")) == ["SpawnSpare"]
        _fails(play)
        assert play.manager.reading().switch_fault == SAID
    assert play.phase is Phase.RUNNING
    assert "Terminate" not in kinds(play.ordered)


def test_that_spares_die_again_and_again_is_told_once() -> None:
    play = _lost()
    play.now_ns += QUIET_NS
    look(play, 0)
    _fails(play)
    told = [order.diagnosis for order in play.ordered if isinstance(order, orders.Alert)]
    assert told.count(Diagnosis.SPARE_LOST) == 1


def test_a_restart_after_spares_have_died_is_tried_first_also_with_the_code_that_serves() -> None:
    play = _lost()
    assert kinds(play.ask(RESTART, build="b1", serves="b1")) == ["SpawnSpare"]


def test_code_that_was_mended_is_switched_to_however_many_spares_had_died() -> None:
    play = _lost()
    play.ask(RESTART, build="b2", serves="b1")
    _waits(play, "b2")
    assert play.phase is Phase.DRAINING


def test_a_refused_update_that_cost_the_spare_is_shown_as_degraded_until_one_is_ready() -> None:
    play = _spared()
    old = play.spare
    play.ask(RESTART, build="bad", serves="b1")
    play.tell(seen.CoreExited(play.now_ns, old, seen.Exit(signal=9), None))
    look(play, 0)
    _fails(play)
    told = play.manager.reading()
    assert (told.state, told.spare_lack) == (HAState.DEGRADED, Lack.DIED)
    play.now_ns += PAUSE_NS
    play.spared("b2")
    assert play.manager.reading().state is HAState.OPERATIONAL


def test_a_wish_before_anybody_looked_at_the_memory_waits_for_that() -> None:
    play = _running()
    assert play.ask(RESTART) == []
    play.tell(seen.Surveyed(play.now_ns, play.life, free_bytes=1))
    assert "Terminate" in kinds(look(play, 0))


def test_the_end_of_a_spare_from_before_the_wish_decides_nothing() -> None:
    play = _running()
    play.tell(seen.Surveyed(play.now_ns, play.life, free_bytes=8 << 30))
    look(play, 0)
    play.ask(RESTART, build="b2", serves="b1")
    _fails(play)
    assert play.manager.reading().switch_waits
    assert kinds(look(play, 0)) == ["SpawnSpare"]
    _waits(play, "b2")
    assert play.phase is Phase.DRAINING


def test_files_that_change_while_a_switch_waits_cost_no_further_spare() -> None:
    play = _spared()
    old = play.spare
    play.ask(RESTART, build="b2", serves="b1")
    play.tell(seen.CoreExited(play.now_ns, old, seen.Exit(signal=9), None))
    play.spared("b3")
    assert play.phase is Phase.DRAINING


def test_a_spare_is_waited_for_from_when_one_may_be_kept() -> None:
    play = _running(Policy(probation_ms=60_000))
    play.tell(seen.Surveyed(play.now_ns, play.life, free_bytes=8 << 30))
    play.die(page=a_page(4, seq=9))
    play.ready(5)
    play.ask(RESTART, build="b2", serves="b1")
    play.ring()
    assert kinds(look(play, 0)) == ["SpawnSpare"]
    _waits(play, "b2")
    assert play.phase is Phase.DRAINING


def test_the_fault_of_a_refused_update_is_not_told_of_what_is_asked_later() -> None:
    for verb in (RESTART, seen.Verb.RESTART_HARD):
        play = _running(Policy(spare=False))
        play.ask(RESTART, build="bad", serves="b1")
        _fails(play)
        assert play.manager.reading().switch_fault
        play.ask(verb, build="b2", serves="b1")
        assert play.manager.reading().switch_fault == ""


def test_the_fault_of_a_refused_update_ends_with_the_core_that_it_spared() -> None:
    play = _running(Policy(spare=False))
    play.ask(RESTART, build="bad", serves="b1")
    _fails(play)
    play.die()
    play.ready(5)
    assert play.manager.reading().switch_fault == ""


def test_beside_a_core_that_reads_only_new_code_is_tried_before_it_is_ended() -> None:
    play = _running()
    play.die(seen.Exit(code=65), a_page(4, words="STORE_CORRUPT"))
    play.tell(seen.CoreReady(play.now_ns, play.life, 4, seen.Proof("none", 0, 9, "")))
    play.ring()
    assert kinds(play.ask(RESTART, build="bad", serves="b1")) == ["SpawnSpare"]
    _fails(play)
    assert play.phase is Phase.RUNNING
    play.ask(RESTART, build="b2", serves="b1")
    assert "Terminate" in kinds(_waits(play, "b2"))


def test_while_an_old_core_is_stuck_no_untried_code_takes_over() -> None:
    play = _spared()
    play.ask(seen.Verb.RESTART_HARD)
    play.now_ns = play.manager.next_deadline_ns() or 0
    play.glance()
    play.ring()
    raised(play, 5)
    proven(play, 5)
    play.ring()
    assert kinds(play.ask(RESTART, build="b2", serves="b1")) == ["Alert"]
    assert play.manager.reading().switch_fault == "an old core is still there"
