"""The spare: when there is one, when it may take over, when it is given up."""

from hardcore.model import observations as seen
from hardcore.model.looks import ProcessSample
from hardcore.model.recorder import Beats, LifeState
from hardcore.recovery.policy import Policy
from hardcore.recovery.spare import (
    DEATHS_MAX,
    LOOK_HOLDS_NS,
    PAUSE_NS,
    QUIET_NS,
    SILENT_NS,
    WINDOW_NS,
    Lack,
    Spare,
    SpareState,
    spare,
)
from tests.unit.recovery.play import MS, S

PLENTY = 8 << 30
SLEEPS = ProcessSample("S", 1, 1 << 20, 3)
T0 = 100 * S


def _beats(loop_ns: int, thread_ns: int | None = None) -> Beats:
    return Beats(
        loop_ns=loop_ns, thread_ns=loop_ns if thread_ns is None else thread_ns, state=LifeState.SPARE
    )


def _waiting(at_ns: int = T0) -> Spare:
    one = spare(Policy())
    one.free_bytes = PLENTY
    one.begin(2, at_ns)
    one.ready(seen.SpareReady(at_ns, 2, "b1", 4))
    one.looked(at_ns, _beats(at_ns), SLEEPS)
    return one


def test_without_a_look_at_the_memory_there_is_no_spare() -> None:
    one = spare(Policy())
    assert not one.comes
    assert not one.due(T0)


def test_a_small_machine_keeps_no_spare_and_says_so() -> None:
    one = spare(Policy(spare_memory_mb=1024))
    one.free_bytes = 1023 << 20
    assert not one.due(T0)
    assert "1024 MB" in one.why_not()


def test_a_spare_that_is_there_is_not_ended_for_the_memory_that_it_takes_itself() -> None:
    one = _waiting()
    one.free_bytes = 0
    assert one.fit(T0)
    assert one.why_not() == ""


def test_a_spare_that_is_turned_off_never_comes() -> None:
    one = spare(Policy(spare=False))
    one.free_bytes = PLENTY
    assert not one.comes
    assert one.why_not() == "it is turned off"


def test_only_one_that_is_ready_may_take_over() -> None:
    one = spare(Policy())
    one.begin(2, T0)
    one.looked(T0, _beats(T0), SLEEPS)
    assert not one.fit(T0)
    one.ready(seen.SpareReady(T0, 2, "b1", 4))
    assert one.fit(T0)


def test_its_word_that_it_is_ready_is_no_look_at_it() -> None:
    one = spare(Policy())
    one.begin(2, T0)
    one.ready(seen.SpareReady(T0, 2, "b1", 4))
    assert not one.fit(T0), "the word may have lain there while we slept"


def test_one_whose_loop_or_thread_is_late_may_not() -> None:
    late_ns = Policy().health_check_timeout_ms * MS + 1
    for loop_ns, thread_ns in ((0, late_ns), (late_ns, 0)):
        one = _waiting()
        now_ns = T0 + S
        one.looked(now_ns, _beats(now_ns - loop_ns, now_ns - thread_ns), SLEEPS)
        assert not one.fit(now_ns)


def test_a_beat_from_the_future_is_none() -> None:
    one = _waiting()
    one.looked(T0 + 2 * S, _beats(T0 + 90 * S), SLEEPS)
    assert not one.fit(T0 + 2 * S)


def test_one_that_is_stopped_or_can_not_be_seen_may_not() -> None:
    for process in (None, ProcessSample("T", 1, 1, 3), ProcessSample("D", 1, 1, 3)):
        one = _waiting()
        one.looked(T0 + MS, _beats(T0 + MS), process)
        assert not one.fit(T0 + MS)


def test_what_was_seen_of_it_holds_only_for_a_while() -> None:
    one = _waiting()
    assert one.fit(T0 + LOOK_HOLDS_NS)
    assert not one.fit(T0 + LOOK_HOLDS_NS + 1)


def test_one_that_is_late_is_kept_and_one_that_is_silent_for_long_is_ended() -> None:
    one = _waiting()
    for at_ns in range(T0, T0 + SILENT_NS + 1, S):
        one.looked(at_ns, _beats(T0), SLEEPS)
        assert not one.hangs(at_ns)
    one.looked(T0 + SILENT_NS + S, _beats(T0), SLEEPS)
    assert "silent" in one.hangs(T0 + SILENT_NS + S)


def test_a_pause_of_the_whole_machine_is_not_held_against_it() -> None:
    one = _waiting()
    after_ns = T0 + 60 * S
    one.looked(after_ns, _beats(T0), SLEEPS)
    assert not one.hangs(after_ns), "nobody had looked"
    assert not one.fit(after_ns), "nor has it proven anything"
    for at_ns in range(after_ns, after_ns + SILENT_NS + 2 * S, S):
        one.looked(at_ns, _beats(T0), SLEEPS)
    assert one.hangs(at_ns), "but it is not forgiven for ever"


def test_one_that_is_not_ready_in_the_time_of_a_start_is_ended() -> None:
    one = spare(Policy(startup_timeout_ms=2000))
    one.begin(2, T0)
    assert not one.hangs(T0 + 2 * S)
    assert "2000 ms" in one.hangs(T0 + 2 * S + 1)


def test_however_often_it_asks_for_time_it_never_has_more_than_another_start() -> None:
    one = spare(Policy(startup_timeout_ms=2000))
    one.begin(2, T0)
    for at_ns in range(T0, T0 + S, 100 * MS):
        one.extend(seen.StartExtended(at_ns, 2, 3600 * S))
    assert not one.hangs(at_ns + 2 * S)
    assert one.hangs(at_ns + 2 * S + 1)


def test_spares_that_die_again_and_again_are_given_up_for_a_while() -> None:
    one = spare(Policy())
    one.free_bytes = PLENTY
    now_ns = T0
    for life in range(DEATHS_MAX + 1):
        assert one.due(now_ns)
        one.begin(2 + life, now_ns)
        assert one.ended("exit 1", now_ns)
        assert not one.due(now_ns + PAUSE_NS - 1), "one that dies at once costs little"
        now_ns += PAUSE_NS
    assert one.lost
    assert not one.due(now_ns)
    assert one.why_not() == "exit 1"
    assert one.due(now_ns + WINDOW_NS)


def test_an_end_that_was_asked_for_counts_for_nothing() -> None:
    one = _waiting()
    one.end("other code lies on the disk now", T0, unasked=False)
    assert one.state is SpareState.ENDING
    assert not one.ended("killed", T0)
    assert one.due(T0)


def test_after_too_many_deaths_one_is_tried_quietly_now_and_then() -> None:
    one = _died_too_often()
    now_ns = one.pause_until_ns
    assert not one.comes, "nobody waits for it"
    assert one.due(now_ns)
    one.begin(9, now_ns)
    assert one.ended("exit 1", now_ns)
    assert not one.due(now_ns + QUIET_NS - 1)
    assert one.due(now_ns + QUIET_NS)


def test_one_that_was_mended_is_no_lack_any_more() -> None:
    one = _died_too_often()
    assert (one.lack, one.why_not()) == (Lack.DIED, "exit 1")
    one.begin(9, one.pause_until_ns)
    assert one.lack is Lack.DIED, "it has to show first that it starts"
    one.ready(seen.SpareReady(one.pause_until_ns, 9, "b2", 4))
    assert (one.why_not(), one.fault) == ("", "")


def test_why_there_is_none_is_said_from_the_first_death_on() -> None:
    one = _waiting()
    one.ended("exit 1", T0)
    assert (one.lack, one.lost) == (Lack.DIED, False)


def test_nobody_knows_yet_is_no_none_will_come() -> None:
    one = spare(Policy())
    assert (one.comes, one.unknown) == (False, True)
    one.survey(None)
    assert (one.comes, one.unknown) == (False, False)
    one.survey(PLENTY)
    assert one.comes


def _died_too_often() -> Spare:
    one = spare(Policy())
    one.free_bytes = PLENTY
    for life in range(DEATHS_MAX + 1):
        one.begin(2 + life, one.pause_until_ns or T0)
        one.ended("exit 1", one.since_ns)
    return one
