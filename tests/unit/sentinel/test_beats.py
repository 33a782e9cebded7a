from hardcore.model.recorder import Beats
from hardcore.model.verdicts import Colour
from hardcore.sentinel.witnesses import beats
from hardcore.sentinel.witnesses.beats import LoneThread, ages
from tests.unit.sentinel.traces import MS, seen


def _beats(loop_ms: int, thread_ms: int) -> Beats:
    return Beats(loop_ns=loop_ms * MS, thread_ns=thread_ms * MS)


def test_a_beat_is_as_old_as_the_time_it_carries() -> None:
    found = ages(_beats(100, 150), seen(200))
    assert (found.loop_ns, found.thread_ns, found.last_loop_ns) == (100 * MS, 50 * MS, 100 * MS)


def test_silence_before_the_amnesty_does_not_count() -> None:
    assert ages(_beats(100, 150), seen(1000, since_ms=900)).loop_ns == 100 * MS


def test_a_beat_from_the_future_is_fresh() -> None:
    assert ages(_beats(500, 500), seen(200)).loop_ns == 0


def test_a_beat_is_stale_after_its_limit_and_not_at_it() -> None:
    found = ages(_beats(100, 100), seen(400))
    assert not found.loop_stale(300)
    assert found.loop_stale(299)


def test_lateness_alone_is_never_red() -> None:
    found = ages(_beats(0, 0), seen(10**6))
    assert beats.testify(found, 300).colour is Colour.YELLOW


def test_who_is_late_is_named_with_its_age() -> None:
    assert beats.testify(ages(_beats(0, 990), seen(1000)), 300).why == "the loop's last beat is 1000 ms old"


def test_fresh_beats_are_green() -> None:
    assert beats.testify(ages(_beats(990, 990), seen(1000)), 300).colour is Colour.GREEN


def test_the_thread_has_to_go_on_alone_in_two_looks() -> None:
    lone = LoneThread()
    assert [lone.look(_beats(100, thread)) for thread in (100, 150, 200)] == [False, False, True]


def test_a_held_interpreter_is_no_lone_thread() -> None:
    lone = LoneThread()
    assert not any(lone.look(_beats(100, 100)) for _ in range(5))
    assert not lone.look(_beats(100, 3000))


def test_a_beat_of_the_loop_ends_the_loneliness() -> None:
    lone = LoneThread()
    trace = [(100, 100), (100, 150), (200, 200), (200, 250)]
    assert not any(lone.look(_beats(*beat)) for beat in trace)
