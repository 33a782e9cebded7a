"""What one resource does over hours: when a claim is made, when it is told, and what is forgotten."""

import random
from collections.abc import Callable

import pytest

from hardcore.sentinel.trends import SCALES, Track, tell
from hardcore.sentinel.trends_log import Chatter

MIB = 1 << 20
S = 1_000_000_000
MINUTE = 60 * S
LIMIT = 512 * MIB
HORIZON = 30 * MINUTE
CONFIRM = 5 * MINUTE


def watch(
    value: Callable[[int], int], minutes: int, track: Track | None = None, begins: int = 0
) -> tuple[Track, list[int]]:
    """Give a track one value every ten seconds; return it and the minutes in which something was told."""
    track = track or Track(MINUTE)
    told = []
    for step in range(begins * 6, (begins + minutes) * 6):
        at_ns = step * 10 * S
        if track.look(at_ns, value(step), step, LIMIT, HORIZON) and tell(track, at_ns, CONFIRM):
            told.append(step // 6)
    return track, told


def leaking(mib_a_minute: float, base: int = 200) -> Callable[[int], int]:
    return lambda step: int((base + mib_a_minute * step / 6) * MIB)


def test_a_leak_is_told_once_and_before_its_limit() -> None:
    _, told = watch(leaking(2), 150)
    assert len(told) == 1
    assert (512 - 200) / 2 - 30 <= told[0] < (512 - 200) / 2


def test_a_leak_whose_limit_is_further_than_the_horizon_is_not_told() -> None:
    _, told = watch(leaking(2), 120)
    assert told == []


def test_a_claim_stands_for_some_minutes_before_it_is_told() -> None:
    track, told = watch(leaking(2), 150)
    assert track.since_ns is not None
    assert told[0] * MINUTE - track.since_ns >= CONFIRM - MINUTE


def test_nothing_counts_before_the_warm_up_is_over() -> None:
    track, told = watch(leaking(20), 20, Track(MINUTE, 15 * MINUTE))
    assert told == []
    assert track.number is not None
    assert len(track.scales[0].lows) < 6


def test_a_level_that_stands_still_close_to_the_limit_is_no_forecast() -> None:
    dice = random.Random(4)
    _, told = watch(lambda _step: int((490 + dice.uniform(0, 8)) * MIB), 600)
    assert told == []


def test_what_lies_above_the_lowest_values_counts_against_the_limit() -> None:
    """A leak under a saw of 100 MiB meets its limit 100 MiB earlier."""
    calm, _ = watch(leaking(1), 120)
    saw, _ = watch(lambda step: leaking(1)(step) + (step % 6) * 20 * MIB, 120)
    near, far = saw.outlook(LIMIT), calm.outlook(LIMIT)
    assert near is not None
    assert far is not None
    assert 80 <= far.due - near.due <= 130


def test_a_forecast_that_ceased_is_forgotten_and_may_be_told_again() -> None:
    track, told = watch(leaking(2), 150)
    assert told
    track, told = watch(lambda _step: 200 * MIB, 30, track, begins=150)
    assert told == []
    assert not track.told


def test_it_has_a_bound_however_long_it_lasts() -> None:
    track, _ = watch(lambda step: (200 + step % 50) * MIB, 60 * 100)
    for scale, (_, kept_max) in zip(track.scales, SCALES, strict=True):
        assert len(scale.lows) <= kept_max
        assert len(scale.lows) == len(scale.highs) == len(scale.loads) == len(scale.numbers)


def test_a_leak_of_megabytes_an_hour_is_seen_on_a_longer_scale() -> None:
    dice = random.Random(9)
    track, told = watch(lambda step: int((380 + 6 * step / 360 + dice.uniform(0, 3)) * MIB), 60 * 22)
    assert told
    assert track.outlook(LIMIT) is not None


def test_time_that_nobody_watched_bends_no_slope() -> None:
    track = Track(MINUTE)
    watch(leaking(1), 40, track)
    watch(leaking(1), 40, track, begins=60)
    outlook = track.outlook(LIMIT)
    assert outlook is not None
    assert outlook.slope.middle / outlook.scale == pytest.approx(MIB, rel=0.05)


def _talk(counts: list[int]) -> Chatter:
    log, written = Chatter(MINUTE), 0
    for minute, count in enumerate([*counts, 0]):
        log.look(minute * MINUTE, written)
        written += count
    return log


def test_a_log_that_always_complains_is_not_told_of() -> None:
    assert _talk([40] * 60).excess(CONFIRM) is None


def test_a_log_that_complains_more_than_it_ever_did_is_told_of() -> None:
    assert _talk([2] * 40 + [50] * 5).excess(CONFIRM) == (50, 10)
    assert _talk([2] * 40 + [50] * 4).excess(CONFIRM) is None, "it has to go on"


def test_of_a_log_nobody_knows_yet_nothing_is_told() -> None:
    assert _talk([50] * 5).excess(CONFIRM) is None
