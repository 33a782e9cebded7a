"""Reads only because a person wants it: it outlives everything, and only that person ends it."""

import pytest

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.phases import HAState, Phase, Wanted
from hardcore.model.verdicts import Diagnosis
from tests.unit.recovery.play import Play, S, a_page, drained, kinds, look, proven, raised

WISH = Diagnosis.OPERATOR
ON = orders.SetSafe


def _switched(play: Play, *, on: bool, done: bool = True) -> list[orders.Action]:
    return play.tell(seen.SafeSwitched(play.now_ns, play.life, on, done, "" if done else "no"))


def _running() -> Play:
    return Play().begin().running()


def _safe(play: Play) -> Play:
    assert play.ask(seen.Verb.SAFE_ON)[0] == ON(play.life, on=True, reason=WISH)
    _switched(play, on=True)
    return play


def _opens(given: list[orders.Action]) -> bool:
    return any(isinstance(one, ON) and not one.on for one in given)


def test_the_core_that_serves_is_told_at_once_and_nobody_is_needed() -> None:
    told = _safe(_running()).manager.reading()
    assert (told.state, told.safe_by, told.wanted) == (HAState.SAFE_MODE, "operator", Wanted.SAFE)
    assert (told.waits_for, told.needs_ns) == (None, None)


def test_it_is_never_left_by_itself() -> None:
    assert _safe(_running()).manager.next_deadline_ns() is None


def test_it_is_left_when_the_operator_says_so() -> None:
    play = _safe(_running())
    assert play.ask(seen.Verb.SAFE_OFF) == [ON(1, on=False, reason=WISH)]
    _switched(play, on=False)
    assert play.manager.reading().state is HAState.OPERATIONAL


def test_a_try_that_the_store_refuses_is_made_again() -> None:
    play = _safe(_running())
    play.ask(seen.Verb.SAFE_OFF)
    _switched(play, on=False, done=False)
    assert play.ring() == [ON(1, on=False, reason=WISH)]


def test_a_resume_does_not_lift_it() -> None:
    play = _safe(_running())
    assert play.ask(seen.Verb.RESUME) == []
    assert play.manager.reading().safe_by == "operator"


def test_nobody_is_sent_to_a_successor_before_it_says_that_it_reads_only() -> None:
    play = _safe(_running())
    play.die()
    play.ready(5)
    assert play.phase is Phase.PROVING
    assert play.ordered[-1] == ON(2, on=True, reason=WISH)
    assert "Release" in kinds(_switched(play, on=True))
    assert play.manager.reading().state is HAState.SAFE_MODE


def test_a_successor_that_does_not_answer_is_told_again() -> None:
    play = _safe(_running())
    play.die()
    play.ready(5)
    assert play.ring() == [ON(2, on=True, reason=WISH)]


def test_a_wish_that_is_taken_back_while_a_core_begins_lets_it_serve() -> None:
    play = _safe(_running())
    play.die()
    play.ready(5)
    assert "Release" in kinds(play.ask(seen.Verb.SAFE_OFF))


def test_a_spare_that_takes_over_reads_only_too() -> None:
    play = _running().spared()
    _safe(play).die()
    raised(play, 5)
    proven(play, 5)
    assert play.phase is Phase.PROVING
    assert "Release" in kinds(_switched(play, on=True))


def test_it_is_there_from_the_first_start_of_a_guard() -> None:
    play = Play(wanted=Wanted.SAFE).begin().ready(4)
    assert play.ordered[-1] == ON(1, on=True, reason=WISH)
    assert "Release" not in kinds(play.ordered)


def test_a_core_that_is_found_serving_is_told_again() -> None:
    play = Play(wanted=Wanted.SAFE)
    page = a_page(4, seq=3)
    assert ON(1, on=True, reason=WISH) in play.tell(seen.SentinelBegan(play.now_ns, adoptable=page))


def test_a_wish_that_was_taken_back_while_nobody_watched_is_taken_back_from_the_core() -> None:
    play = _running()
    play.now_ns += S
    found = seen.Probed(play.now_ns, 1, play.now_ns, answered=True, writes=False, safe=WISH)
    assert play.tell(found) == [ON(1, on=False, reason=WISH)]
    assert play.manager.reading().incident is None


@pytest.mark.parametrize("verb", [seen.Verb.SAFE_ON, seen.Verb.SAFE_OFF])
def test_what_is_stopped_stays_so(verb: seen.Verb) -> None:
    play = _running()
    play.ask(seen.Verb.STOP)
    play.ask(verb)
    assert play.manager.wanted is Wanted.DOWN


def test_a_disk_that_has_room_again_does_not_open_what_a_person_closed() -> None:
    play = _running()
    play.tell(seen.StoreTold(play.now_ns, 1, seen.StoreFault.FULL))
    play.ask(seen.Verb.SAFE_ON)
    assert play.manager.reading().safe_by == "operator"
    for _ in range(5):
        assert play.manager.next_deadline_ns() is None or not _opens(play.ring())


def test_a_trouble_that_has_passed_is_over_though_a_person_wants_reads_only_and_no_write_is_tried() -> None:
    play = _running()
    play.tell(seen.StoreTold(play.now_ns, 1, seen.StoreFault.FULL))
    play.ask(seen.Verb.SAFE_ON)
    ordered = [one for _ in range(1200) for one in look(play, 0)]  # two minutes
    assert ON(1, on=True, reason=WISH) in ordered
    _switched(play, on=True)
    ordered += [one for _ in range(1200) for one in look(play, 0)]
    told = play.manager.reading()
    assert (told.incident, told.state, told.safe) == (None, HAState.SAFE_MODE, WISH)
    assert not _opens(ordered)


def test_a_damaged_ledger_stays_read_only_when_the_wish_is_over() -> None:
    play = _safe(_running())
    play.tell(seen.LedgerAudited(play.now_ns, 1, None, "the chain is broken"))
    _switched(play, on=True)
    assert not _opens(play.ask(seen.Verb.SAFE_OFF))
    assert play.manager.reading().safe is Diagnosis.STORE_CORRUPT


def test_a_wish_that_comes_while_the_core_is_drained_holds_if_it_serves_again() -> None:
    play = _running().spared()
    play.ask(seen.Verb.RESTART)
    play.ask(seen.Verb.SAFE_ON)
    assert ON(1, on=True, reason=WISH) in drained(play, done=False)


def test_an_order_that_is_obeyed_when_the_wish_is_over_is_taken_back() -> None:
    play = Play(wanted=Wanted.SAFE).begin().ready(4)
    assert "Release" in kinds(play.ask(seen.Verb.SAFE_OFF))
    assert _opens(_switched(play, on=True))
    _switched(play, on=False)
    assert play.manager.reading().safe is None
