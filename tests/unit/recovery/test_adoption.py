"""A guard that finds a core serving goes on with it: nobody was stopped, and nobody is."""

from typing import TypeVar

import pytest

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.phases import HAState, Phase, Wanted
from hardcore.model.recorder import Witness
from hardcore.model.verdicts import Diagnosis
from tests.unit.recovery.play import MS, Play, a_page, deciding, kinds

T = TypeVar("T")


def _spared() -> Play:
    return Play().begin().running(4).spared()


def _last(play: Play, kind: type[T]) -> T:
    return [order for order in play.ordered if isinstance(order, kind)][-1]


def _found(wanted: Wanted = Wanted.UP) -> Play:
    play = Play(wanted=wanted)
    page = a_page(6, seq=9)
    play.tell(seen.SentinelBegan(play.now_ns, leftovers=True, page=page, adoptable=page, suspects=("k1",)))
    return play


def test_a_core_that_serves_goes_on_under_a_new_guard() -> None:
    play = _found()
    assert (play.phase, play.manager.reading().epoch) == (Phase.RUNNING, 6)
    assert play.manager.reading().state is HAState.OPERATIONAL
    assert [x for x in kinds(play.ordered) if x != "Alert"] == [
        "KeepCourt",
        "Adopt",
        "KillLeftovers",
        "Release",
        "CloseIncident",
    ]
    assert play.closed().diagnosis is Diagnosis.SENTINEL_LOST
    assert play.closed().deaths == ()


@pytest.mark.parametrize(
    ("served_ms", "phase"), [(0, Phase.PROBATION), (1999, Phase.PROBATION), (2000, Phase.RUNNING)]
)
def test_a_core_that_had_only_just_begun_to_serve_has_yet_to_last(served_ms: int, phase: Phase) -> None:
    play = Play()
    page, since_ns = a_page(6, seq=9), play.now_ns - served_ms * MS
    play.tell(seen.SentinelBegan(play.now_ns, page=page, adoptable=page, serves_since_ns=since_ns))
    assert play.phase is phase
    if phase is Phase.PROBATION:
        play.ring()
        assert play.phase is Phase.RUNNING
    assert play.closed().diagnosis is Diagnosis.SENTINEL_LOST


def test_nobody_is_suspect_of_an_end_that_nobody_could_read() -> None:
    play = _found()
    page = a_page(6, deciding("innocent"), seq=9)
    play.die(seen.Exit(), page)
    play.tell(seen.EvidenceTaken(play.now_ns, play.life - 1, True, page))
    play.ready(7)
    assert "innocent" not in _last(play, orders.Release).suspects


def test_whom_the_guard_before_suspected_is_not_run_again() -> None:
    assert _last(_found(), orders.Release).suspects == ("k1",)


def test_the_end_of_the_leftovers_is_not_the_end_of_the_core_that_goes_on() -> None:
    play = _found()
    play.tell(seen.CoreExited(play.now_ns, 0, seen.Exit(signal=9), a_page(5)))
    assert play.phase is Phase.RUNNING


def test_a_core_that_is_found_and_not_wanted_is_asked_to_leave() -> None:
    play = _found(Wanted.DOWN)
    assert isinstance(play.ordered[-1], orders.Terminate)
    assert kinds(play.die(seen.Exit(code=0)))[-1] == "Halt"


def test_the_core_that_was_gone_on_with_has_a_successor_that_shows_its_commits() -> None:
    play = _found()
    play.die(page=a_page(6, seq=12))
    assert play.spawned().witnesses == (Witness(12, 6, "h12"),)


def test_no_epoch_is_certain_after_leftovers() -> None:
    play = Play()
    play.tell(seen.SentinelBegan(play.now_ns, leftovers=True, page=a_page(6, seq=9)))
    play.die(page=a_page(6, seq=9))
    assert play.spawned().expected_epoch is None, "one that was promoted may have died before we began"
