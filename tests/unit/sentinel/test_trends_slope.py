"""The robust slope and its bound: what bends it, what does not, and what it says nothing of."""

import random

import pytest

from hardcore.sentinel.trends_slope import POINTS_MIN, Points, growth, has_left, may_grow, swing

MIB = 1 << 20


def rows(lows: list[int], loads: list[int] | None = None) -> Points:
    return Points(range(len(lows)), lows, lows, loads or [10] * len(lows))


def noisy(count: int, slope: float, sigma: float, seed: int = 1) -> list[int]:
    dice = random.Random(seed)
    return [int(100 * MIB + slope * step + dice.gauss(0, sigma)) for step in range(count)]


def test_a_straight_line_is_told_exactly() -> None:
    found = growth(rows([1000 + 7 * step for step in range(40)]))
    assert found is not None
    assert found.middle == pytest.approx(7)
    assert found.low == pytest.approx(7)


def test_the_lower_bound_lies_below_the_slope_and_comes_nearer_with_more_points() -> None:
    few, many = growth(rows(noisy(20, MIB, 2 * MIB))), growth(rows(noisy(80, MIB, 2 * MIB)))
    assert few is not None
    assert many is not None
    assert few.low < few.middle
    assert 0 < many.middle - many.low < few.middle - few.low


def test_a_few_wild_points_do_not_bend_it() -> None:
    lows = [1000 + 7 * step for step in range(60)]
    lows[10], lows[30], lows[50] = 1, 10**9, 5
    found = growth(rows(lows))
    assert found is not None
    assert found.middle == pytest.approx(7, rel=0.01)


def test_of_few_points_nothing_is_said() -> None:
    assert growth(rows(list(range(POINTS_MIN - 1)))) is None
    assert not has_left(list(range(POINTS_MIN - 1)), 0.1)


def test_noise_alone_is_no_growth() -> None:
    claimed = [
        found
        for seed in range(40)
        if (found := growth(rows(noisy(60, 0, MIB, seed)))) is not None and found.low > 0
    ]
    assert len(claimed) <= 2, "one in a hundred, for each of three windows"


def test_a_step_that_was_taken_once_is_no_trend() -> None:
    lows = [100 * MIB] * 30 + [160 * MIB] * 30
    found = growth(rows(lows))
    assert found is None or found.low <= 0


def test_what_follows_its_load_is_no_growth_of_its_own() -> None:
    loads = [10 + 20 * step for step in range(60)]
    lows = [100 * MIB + load * 50_000 for load in loads]
    found = growth(rows(lows, loads))
    assert found is None or found.low <= 0, "too few pairs are comparable to say anything"
    assert growth(rows(lows)) is not None, "the same growth under an even load is told"


def test_values_that_left_where_they_began_and_came_back_have_not_left() -> None:
    away = [100 * MIB + step * MIB for step in range(30)]
    assert has_left(away, 0.1 * MIB)
    assert not has_left([*away, *(100 * MIB for _ in range(10))], 0.1 * MIB)


def test_the_swing_is_what_nine_in_ten_stay_below() -> None:
    points = Points(range(30), [100] * 30, [110] * 29 + [900], [1] * 30)
    assert swing(points) == 10


def test_a_cheap_look_never_says_no_where_the_slope_would_reach_it() -> None:
    for seed in range(30):
        lows = noisy(60, MIB, 3 * MIB, seed)
        found = growth(rows(lows))
        if found is not None and found.low > 0:
            assert may_grow(lows, found.low)


def test_growth_is_told_under_a_load_of_which_hardly_two_points_are_alike() -> None:
    dice = random.Random(4)
    loads = [int(dice.lognormvariate(3, 1.5)) for _ in range(60)]
    found = growth(rows(noisy(60, MIB, MIB), loads))
    assert found is not None
    assert found.low > 0


def test_what_follows_a_load_of_which_hardly_two_points_are_alike_is_no_growth() -> None:
    claimed = []
    for seed in range(40):
        dice = random.Random(seed)
        loads = [int(dice.lognormvariate(3, 1.5)) for _ in range(60)]
        found = growth(rows([100 * MIB + load * 50_000 for load in loads], loads))
        claimed += [seed] if found is not None and found.low > 0 else []
    assert not claimed
