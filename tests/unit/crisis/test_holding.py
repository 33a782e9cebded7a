"""The life of a request: the table is total, and keeps the two promises of exactly once."""

import itertools

import pytest

from hardcore.crisis.feed import Verdict
from hardcore.crisis.holding import (
    OVER,
    SENDS_MAX,
    TABLE,
    Deed,
    Life,
    Plea,
    Trigger,
    WaitingRoom,
    after_death,
    after_release,
    after_verdict,
    hold_limit_ms,
)
from hardcore.crisis.problems import Problem
from hardcore.settings import Limits

SAYS = {deed for deed in Deed if deed.name.startswith(("SAY_", "DROP_"))} | {
    Deed.PASS_ON,
    Deed.FINISH,
    Deed.CUT,
}


def _plea(
    *, safe: bool = False, key: str | None = "k", kept: bool = True, whole: bool = True, sends: int = 1
) -> Plea:
    return Plea(safe=safe, key_hash=key, body_kept=kept, sent_whole=whole, sends=sends)


def test_the_table_answers_every_trigger_in_every_life() -> None:
    assert set(TABLE) == set(itertools.product(Life, Trigger))


def test_a_life_ends_exactly_when_something_is_said() -> None:
    for (life, _), (after, deed) in TABLE.items():
        assert (deed in SAYS) is (after in OVER and life not in OVER)


def test_after_the_end_nothing_happens_any_more() -> None:
    for life, trigger in itertools.product(OVER, Trigger):
        assert TABLE[life, trigger] == (life, Deed.NOTHING)


def test_a_request_reaches_a_core_only_when_it_is_passed_or_repeated() -> None:
    ways = {(life, trigger) for (life, trigger), (_, deed) in TABLE.items() if deed is Deed.SEND}
    assert ways == {(Life.ARRIVED, Trigger.PASS), (Life.HELD, Trigger.PASS), (Life.LOST, Trigger.REPEAT)}


def test_not_done_is_said_only_of_what_no_core_has_run_or_a_later_one_has_looked_up() -> None:
    unseen = {Life.ARRIVED, Life.HELD, Life.KEEPING}
    for (life, trigger), (_, deed) in TABLE.items():
        if deed in {Deed.SAY_NOT_DONE, Deed.DROP_UNSENT}:
            assert life in unseen or trigger is Trigger.NOT_RUN_SPENT
        if deed is Deed.SAY_ABSENT:
            assert (life, trigger) == (Life.ASKED, Trigger.ABSENT)
        if deed is Deed.SAY_UNTRIED:
            assert life is Life.ON_TRIAL


def test_a_lost_request_never_becomes_one_that_no_core_has_seen() -> None:
    unseen = {Life.ARRIVED, Life.HELD}
    ways = {
        (life, trigger)
        for life, trigger in itertools.product((Life.LOST, Life.ASKED), Trigger)
        if TABLE[life, trigger][0] in unseen
    }
    assert ways == {(Life.ASKED, Trigger.LET_GO)}, "but one that was only asked about"


def test_only_a_suspect_that_a_later_core_does_not_have_goes_on_trial() -> None:
    ways = {pair for pair, (after, _) in TABLE.items() if after is Life.ON_TRIAL and pair[0] is not after}
    assert ways == {(Life.ASKED, Trigger.SUSPECTED)}


def test_only_a_cleared_suspect_may_reach_a_core_again() -> None:
    ways = {
        trigger
        for trigger in Trigger
        if TABLE[Life.ON_TRIAL, trigger][0] in {Life.HELD, Life.FORWARDED, Life.LOST, Life.ASKED}
    }
    assert ways == {Trigger.CLEARED}


def test_the_death_of_a_core_means_nothing_to_whoever_is_on_trial() -> None:
    for trigger in (Trigger.CORE_LOST, Trigger.CORE_LOST_FOR_GOOD, Trigger.REPEAT, Trigger.ASK):
        assert TABLE[Life.ON_TRIAL, trigger] == (Life.ON_TRIAL, Deed.NEVER)


@pytest.mark.parametrize(
    ("outcome", "sendable", "trigger"),
    [
        (Verdict.CLEARED, True, Trigger.CLEARED),
        (Verdict.CLEARED, False, Trigger.DROPPED),
        (Verdict.CONVICTED, True, Trigger.CONVICTED),
        (Verdict.HELD, True, Trigger.HELD_BACK),
        (Verdict.DROPPED, True, Trigger.DROPPED),
    ],
)
def test_a_verdict_runs_a_request_only_if_it_cleared_it(
    outcome: Verdict, sendable: bool, trigger: Trigger
) -> None:
    assert after_verdict(outcome, sendable=sendable) is trigger


def test_every_life_can_end() -> None:
    for life in Life:
        assert any(TABLE[life, trigger][0] in OVER for trigger in Trigger)


@pytest.mark.parametrize(
    "life", [Life.HELD, Life.FORWARDED, Life.ANSWERING, Life.LOST, Life.ASKED, Life.ON_TRIAL]
)
@pytest.mark.parametrize("trigger", [Trigger.LIMIT, Trigger.TURN_AWAY, Trigger.CLIENT_LEFT])
def test_time_leaving_and_the_gateways_end_can_come_at_any_moment(life: Life, trigger: Trigger) -> None:
    after, deed = TABLE[life, trigger]
    assert after in OVER
    assert deed is not Deed.NEVER


def test_a_request_without_a_key_is_lost_for_good() -> None:
    assert after_death(_plea(key=None)) is Trigger.CORE_LOST_FOR_GOOD


def test_an_unfinished_upload_is_lost_for_good() -> None:
    assert after_death(_plea(whole=False, kept=False)) is Trigger.CORE_LOST_FOR_GOOD


def test_a_request_with_a_key_can_still_be_looked_up_though_its_body_is_gone() -> None:
    assert after_death(_plea(kept=False)) is Trigger.CORE_LOST
    assert after_release(_plea(kept=False), suspected=False, newer=True) is Trigger.ASK


def test_a_suspect_is_only_asked_about() -> None:
    assert after_release(_plea(), suspected=True, newer=True) is Trigger.ASK
    assert after_release(_plea(), suspected=False, newer=True) is Trigger.REPEAT


def test_the_core_that_had_an_unsafe_request_is_only_asked_about_it() -> None:
    assert after_release(_plea(), suspected=False, newer=False) is Trigger.ASK
    assert after_release(_plea(safe=True), suspected=False, newer=False) is Trigger.REPEAT


def test_what_the_core_that_had_it_does_not_know_stays_lost() -> None:
    assert TABLE[Life.ASKED, Trigger.NOT_YET] == (Life.LOST, Deed.ASK_LATER)


def test_an_unsafe_request_is_repeated_once() -> None:
    assert after_release(_plea(sends=1), suspected=False, newer=True) is Trigger.REPEAT
    assert after_release(_plea(sends=2), suspected=False, newer=True) is Trigger.ASK


def test_a_safe_request_is_sent_a_bounded_number_of_times() -> None:
    lost = [after_death(_plea(safe=True, key=None, sends=n)) for n in range(1, SENDS_MAX + 1)]
    assert lost == [Trigger.CORE_LOST] * (SENDS_MAX - 1) + [Trigger.CORE_LOST_FOR_GOOD]
    assert after_release(_plea(safe=True, key=None, sends=2), suspected=False, newer=True) is Trigger.REPEAT


def test_a_navigation_never_waits_longer_than_any_other_request() -> None:
    assert hold_limit_ms(Limits(hold_ms=100, navigation_hold_ms=400), navigation=True) == 100
    assert hold_limit_ms(Limits(hold_ms=900, navigation_hold_ms=400), navigation=True) == 400
    assert hold_limit_ms(Limits(hold_ms=900, navigation_hold_ms=400), navigation=False) == 900


def test_the_waiting_room_counts_heads_and_gives_their_places_back() -> None:
    room = WaitingRoom(Limits(hold_requests_max=2, hold_per_browser_max=1))
    assert room.enter(b"a") is None
    assert room.enter(b"a") is Problem.TOO_BUSY
    assert room.enter(None) is None
    assert room.enter(b"b") is Problem.TOO_BUSY
    room.leave(b"a")
    assert room.enter(b"a") is None


def test_the_waiting_room_counts_bytes_and_gives_them_back() -> None:
    room = WaitingRoom(Limits(hold_bytes_max=1024))
    assert room.take_bytes(1024)
    assert not room.take_bytes(1)
    room.give_bytes(1024)
    assert room.take_bytes(1)


def test_giving_back_what_was_never_taken_is_our_own_bug() -> None:
    with pytest.raises(AssertionError, match="given back"):
        WaitingRoom(Limits()).give_bytes(1)
    with pytest.raises(AssertionError, match="never entered"):
        WaitingRoom(Limits()).leave(None)
