"""The promise of a time: it holds as often as it says, and it is not made out of too little."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardcore.crisis.estimate import (
    SAMPLES_MAX,
    SAMPLES_MIN,
    Range,
    Sample,
    Score,
    Told,
    Way,
    bound,
    estimate,
    in_seconds,
    middle,
    narrowed,
    sample,
    score,
    youngest,
)

TIMES = st.lists(st.integers(0, 10**7), min_size=1, max_size=50)


def _flat(*totals: int) -> list[Sample]:
    return [sample(total, ()) for total in totals]


def test_with_too_few_outages_behind_us_nothing_is_promised() -> None:
    assert estimate(_flat(*[100] * (SAMPLES_MIN - 1)), 1, 0) is None
    assert estimate(_flat(*[100] * SAMPLES_MIN), 1, 0) == Range(100, 150)


def test_the_bound_is_an_order_statistic_from_nine_outages_on() -> None:
    assert bound([10, 20, 30]) == 45
    assert bound(list(range(1, 9))) == 12
    assert bound(list(range(1, 10))) == 9
    assert bound(list(range(1, 20))) == 18
    assert bound(list(range(1, 51))) == 46


@given(TIMES)
def test_the_middle_is_never_past_the_bound(times: list[int]) -> None:
    assert middle(times) <= bound(times)


@pytest.mark.parametrize("count", [9, 19, 49])
def test_the_bound_holds_nine_times_in_ten(count: int) -> None:
    chance = random.Random(7)
    draws = [[chance.lognormvariate(0, 1) * 1000 for _ in range(count + 1)] for _ in range(4000)]
    held = sum(bound([int(x) for x in draw[:-1]]) >= int(draw[-1]) for draw in draws)
    assert held / len(draws) >= 0.88


def test_a_stage_that_was_passed_over_counts_as_reached_with_the_next() -> None:
    assert sample(1000, [(1, 10), (3, 400)]) == Sample(1000, (0, 400, 400, 1000))
    assert sample(1000, []) == Sample(1000, (0, 1000, 1000, 1000))
    assert sample(1000, [(2, 5000)]) == Sample(1000, (0, 1000, 1000, 1000))


def test_what_is_left_is_asked_anew_at_each_stage() -> None:
    # Slow to find, quick from there: once the third stage is reached early, it will be over early.
    samples = [sample(3000, [(1, 0), (2, 2500), (3, 2600)])] * 5
    assert estimate(samples, 1, 0) == Range(3000, 4500)
    assert estimate(samples, 3, 100) == Range(500, 700)


@given(st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 10**6)), min_size=1, max_size=9))
def test_what_was_told_never_grows(promises: list[tuple[int, int]]) -> None:
    told: Told | None = None
    for low, more in promises:
        newer = narrowed(told, in_seconds(Range(low, low + more)))
        assert newer is not None
        assert newer.low_s < newer.high_s
        if told is not None:
            assert newer.low_s <= told.low_s
            assert newer.high_s <= told.high_s
        told = newer
    assert narrowed(told, None) == told


def test_a_shorter_time_in_finer_steps_does_not_lift_the_lower_number() -> None:
    first = in_seconds(Range(40_000, 60_000))
    assert first == Told(30, 60)
    assert narrowed(first, in_seconds(Range(42_000, 54_000))) == Told(30, 55)


@given(st.integers(0, 10**7), st.integers(0, 10**7))
def test_the_seconds_that_are_told_hold_what_was_meant(low_ms: int, more_ms: int) -> None:
    told = in_seconds(Range(low_ms, low_ms + more_ms))
    assert 0 <= told.low_s < told.high_s
    assert told.low_s * 1000 <= low_ms
    assert told.high_s * 1000 >= low_ms + more_ms


@pytest.mark.parametrize(
    ("low_ms", "high_ms", "told"),
    [
        (300, 900, (0, 1)),
        (1200, 3100, (1, 4)),
        (2000, 2000, (2, 3)),
        (12_000, 31_000, (10, 35)),
        (70_000, 95_000, (60, 105)),
    ],
)
def test_seconds_are_rounded_outwards_and_coarser_the_longer(
    low_ms: int, high_ms: int, told: tuple[int, int]
) -> None:
    assert in_seconds(Range(low_ms, high_ms)) == Told(*told)


def test_a_promise_is_kept_by_an_end_in_time_and_broken_by_a_late_one_alone() -> None:
    early, late = (sample(total, (), Way.SPARE, Told(1, 2)) for total in (100, 2_001))
    assert (early.within, late.within) == (True, False)
    assert score([early, late, sample(5, ())]) == Score(samples=3, scored=2, within=1)


def test_many_outages_of_one_way_do_not_push_out_the_few_of_the_other() -> None:
    cold = [sample(9_000, (), Way.COLD)]
    kept = youngest([*cold, *(sample(n, (), Way.SPARE) for n in range(SAMPLES_MAX + 7))])
    assert len(kept) == 1 + SAMPLES_MAX
    assert kept[0] == cold[0]
    assert kept[1].total_ms == 7
