"""What is told of a resource over time: each moment once, the older ones coarser, and where it leads."""

from itertools import pairwise

import pytest

from hardcore.curves import Curves
from hardcore.model.forecasts import Resource
from hardcore.recovery.foresight import Foresight
from hardcore.sentinel.trends import Track

MINUTE = 60_000_000_000
MIB = 1 << 20
LIMIT = 512 * MIB


def _grown(minutes: int, mib_a_minute: float = 0.1) -> Foresight:
    track = Track(MINUTE)
    for minute in range(minutes):
        track.look(minute * MINUTE, int((100 + minute * mib_a_minute) * MIB), minute, LIMIT, 30 * MINUTE)
    return Foresight(1, tracks={Resource.MEMORY: track}, limits={Resource.MEMORY: LIMIT})


def test_each_moment_is_told_once_in_its_order_and_the_older_ones_are_coarser() -> None:
    (told,) = Curves().told(_grown(600), 600 * MINUTE)
    seconds = [point[0] for point in told["points"]]
    assert seconds == sorted(seconds)
    assert len(set(seconds)) == len(seconds)
    assert seconds[0] <= -9 * 3600
    assert seconds[-1] >= -120
    gaps = [after - before for before, after in pairwise(seconds)]
    assert max(gaps) <= 2 * 1800
    assert gaps[-1] == 60


def test_a_slow_growth_is_told_with_the_day_on_which_it_ends() -> None:
    (told,) = Curves().told(_grown(600), 600 * MINUTE)
    assert told["per_hour"] == pytest.approx(6 * MIB, rel=0.05)
    assert told["per_hour_low"] <= told["per_hour"]
    assert told["due"] is not None


def test_what_does_not_grow_leads_nowhere() -> None:
    (told,) = Curves().told(_grown(600, 0), 600 * MINUTE)
    assert (told["per_hour"], told["due"]) == (None, None)
    assert told["level"] == 100 * MIB


def test_a_resource_that_was_just_begun_has_no_points_yet() -> None:
    (told,) = Curves().told(_grown(1), MINUTE)
    assert told["points"] == []
    assert told["level"] is None
