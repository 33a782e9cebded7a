"""What a core says of itself when it is asked for its health counts, also where no word of it was heard before."""

import pytest

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.phases import HAState, Phase
from hardcore.model.verdicts import Diagnosis
from tests.unit.recovery.play import MS, Play, S, a_page, kinds

FULL, CORRUPT = Diagnosis.DISK_FULL, Diagnosis.STORE_CORRUPT


def _found() -> Play:
    """A new guard has gone on with a core; who told it what before is not known."""
    play = Play()
    page = a_page(6, seq=9)
    play.tell(seen.SentinelBegan(play.now_ns, page=page, adoptable=page))
    return play


def _probed(play: Play, safe: Diagnosis | None, *, ago_ms: int = 1, writes: bool | None = None) -> list[str]:
    """The core answers a question that was asked a moment ago."""
    play.now_ns += 1000 * MS
    told = safe is None if writes is None else writes
    asked_ns = play.now_ns - ago_ms * MS
    fact = seen.Probed(play.now_ns, play.life, asked_ns, True, 6, 9, told, safe)
    return kinds(play.tell(fact))


def test_a_core_that_is_found_to_read_only_is_said_to_and_a_write_is_tried() -> None:
    play = _found()
    _probed(play, FULL)
    assert (play.manager.reading().safe, play.manager.reading().state) == (FULL, HAState.SAFE_MODE)
    assert play.manager.open_incident() is not None
    while not any(isinstance(order, orders.SetSafe) for order in play.ordered):
        play.ring()
    tried = next(order for order in play.ordered if isinstance(order, orders.SetSafe))
    assert not tried.on
    play.tell(seen.SafeSwitched(play.now_ns, play.life, on=False, done=True))
    assert play.manager.reading().safe is None


def test_a_core_that_says_so_again_is_no_news() -> None:
    play = _found()
    _probed(play, FULL)
    story = play.manager.open_incident()
    assert _probed(play, FULL) == []
    assert play.manager.open_incident() == story


def test_an_answer_to_a_question_from_before_the_switch_is_passed_over() -> None:
    play = _found()
    play.now_ns += S
    play.tell(seen.StoreTold(play.now_ns, play.life, seen.StoreFault.FULL))
    _probed(play, None, ago_ms=2000)
    assert play.manager.reading().safe is FULL


def test_a_damaged_ledger_that_is_found_out_waits_for_a_person() -> None:
    play = _found()
    _probed(play, CORRUPT)
    assert play.manager.reading().safe is CORRUPT
    assert play.manager.reading().waits_for == CORRUPT


def test_a_core_that_writes_again_and_was_not_heard_to_say_so_is_believed() -> None:
    play = _found()
    play.now_ns += S
    play.tell(seen.StoreTold(play.now_ns, play.life, seen.StoreFault.FULL))
    _probed(play, None)
    assert (play.manager.reading().safe, play.phase) == (None, Phase.RUNNING)


def test_a_damaged_ledger_is_not_written_to_because_its_core_does() -> None:
    play = _found()
    _probed(play, CORRUPT)
    assert _probed(play, None) == ["SetSafe"]


@pytest.mark.parametrize("safe", [None, FULL])
def test_a_core_that_does_not_say_so_is_taken_for_what_it_was(safe: Diagnosis | None) -> None:
    play = _found()
    if safe is not None:
        _probed(play, safe)
    play.now_ns += 1000 * MS
    play.tell(seen.Probed(play.now_ns, play.life, play.now_ns - 1, answered=True))
    assert play.manager.reading().safe is safe
