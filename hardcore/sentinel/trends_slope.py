"""How fast something grows, and how slowly it may be growing at least: a robust slope with its lower bound.

The slope is Theil and Sen's: the median of the slopes of all pairs of points, which a third of wild points can't bend.
Its lower bound is read off the same sorted slopes at the place that Kendall's variance gives, and the variance is
widened by how much neighbours resemble each other, because a sawtooth is no sequence of independent looks. Only pairs
whose later point was under no more load than the earlier one, and not under much less, count: what grows because more
is asked of it is no leak, and where the load only rises too few pairs are left to say anything. Where the load is so wide
that hardly two points are alike, all pairs count whose later point was under no more of it: what grows though less is asked
is a leak the more, and what shrinks with the load makes the slope smaller and not larger. Least squares was not chosen: one flushed cache would tilt it.

The second opinion is a one-sided CUSUM over the same points: it asks not how fast, but whether the values have left
where they began and are still leaving. Where either says no, nothing is claimed.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from statistics import median

import msgspec

#: With fewer points nothing is said.
POINTS_MIN = 12
#: The newest part of the points has to grow as well: a step that was taken once is no trend.
RECENT_SHARE, RECENT_MIN = 1 / 3, 8
#: What began to grow lately is seen in the newer two thirds, or the newest third, if they have so many points.
WINDOW_MIN = 20
#: A slope is worth its exact look if so many times the difference between the ends would be enough.
CRUDE, CRUDE_POINTS = 3, 5
#: One-sided confidence of the lower bound: 99 %.
Z = 2.33
#: Neighbours that resemble each other widen the band by at most so much.
WIDER_MAX = 16.0
#: The later load is not much less within this share of the earlier one, or within twice its own chance.
LIKE_SHARE = 0.15
#: So many of all pairs must be comparable.
PAIRS_SHARE_MIN = 0.2
#: CUSUM: what is forgiven at each point, and what has to be gathered, in standard deviations.
SLACK, GATHERED = 0.5, 5.0
#: Differences of normal noise: their median deviation, as a standard deviation of the noise itself.
_MAD, _ROOT2 = 1.4826, math.sqrt(2)


class Points(msgspec.Struct, frozen=True):
    """Equally long stretches, the oldest first: their numbers, the lowest and the highest value in each, its load."""

    numbers: Sequence[int]
    lows: Sequence[int]
    highs: Sequence[int]
    loads: Sequence[int]


class Slope(msgspec.Struct, frozen=True):
    """Growth for each stretch: what it most likely is, and what it is at least."""

    middle: float
    low: float


def growth(points: Points) -> Slope | None:
    """Return how fast the lowest values grow: of all points and of the newest of them the slower; None: nobody can
    tell. What began to grow lately is looked for in the newer points alone.
    """
    found = [_steady(points, count) for count in _windows(len(points.lows))]
    return max((one for one in found if one is not None), key=lambda one: one.low, default=None)


def may_grow(lows: Sequence[int], needed: float) -> bool:
    """Return whether a slope of `needed` is not out of the question: cheap, and generous."""
    return any(
        CRUDE * (median(lows[-CRUDE_POINTS:]) - median(lows[-count:][:CRUDE_POINTS]))
        >= needed * (count - CRUDE_POINTS)
        for count in _windows(len(lows))
    )


def _windows(count: int) -> list[int]:
    shorter = {round(count * share) for share in (2 / 3, 1 / 3)}
    return [count, *sorted((one for one in shorter if one >= WINDOW_MIN), reverse=True)] * (
        count >= POINTS_MIN
    )


def _steady(points: Points, window: int) -> Slope | None:
    """Return the slope of the newest `window` points, or that of the newest of them where that is slower."""
    count = len(points.lows)
    recent = max(RECENT_MIN, round(window * RECENT_SHARE))
    whole = _slope(points, count - window)
    newest = _slope(points, count - recent)
    if whole is None or newest is None:
        return None
    return Slope(min(whole.middle, newest.middle), min(whole.low, newest.low))


def swing(points: Points) -> int:
    """Return how far the highest values lie above the lowest of their stretch, as a rule: nine in ten are below."""
    recent = max(RECENT_MIN, round(len(points.lows) * RECENT_SHARE))
    pairs = zip(points.highs, points.lows, strict=True)
    swings = sorted([high - low for high, low in pairs][-recent:])
    return swings[int(0.9 * (len(swings) - 1))] if swings else 0


def has_left(lows: Sequence[int], floor: float) -> bool:
    """Return whether the values have left where they began, upwards, and are still leaving. `floor`: the least noise
    that is believed.
    """
    if len(lows) < POINTS_MIN:
        return False
    reference = median(lows[: max(3, len(lows) // 3)])
    steps = [after - before for before, after in pairwise(lows)]
    usual = median(steps)
    noise = max(floor, _MAD * median(abs(step - usual) for step in steps) / _ROOT2)
    gathered, most = 0.0, 0.0
    for low in lows:
        most = max(most, gathered)
        gathered = max(0.0, gathered + low - reference - SLACK * noise)
    return gathered > GATHERED * noise and gathered >= most


def _slope(points: Points, first: int) -> Slope | None:
    """Return the slope of the points from `first` on; None where too few pairs are comparable."""
    numbers, lows, loads = points.numbers[first:], points.lows[first:], points.loads[first:]
    count = len(lows)
    pairs = count * (count - 1) // 2
    enough = max(POINTS_MIN, PAIRS_SHARE_MIN * pairs)
    no_more = [(i, j) for j in range(1, count) for i in range(j) if loads[j] <= loads[i]]
    alike = [(i, j) for i, j in no_more if _alike(loads[i], loads[j])]
    counted = alike if len(alike) >= enough else no_more
    if len(counted) < enough:
        return None
    slopes = sorted((lows[j] - lows[i]) / (numbers[j] - numbers[i]) for i, j in counted)
    middle = median(slopes)
    kendall = math.sqrt(count * (count - 1) * (2 * count + 5) / 18 * _wider(numbers, lows, middle))
    place = int((len(slopes) - Z * kendall * len(slopes) / pairs) / 2)
    return Slope(middle, slopes[place]) if place >= 0 else None


def _alike(earlier: int, later: int) -> bool:
    """Whether the later load, which is no more than the earlier one, is not much less."""
    return earlier - later <= max(LIKE_SHARE * earlier, 2 * math.sqrt(earlier))


def _wider(numbers: Sequence[int], lows: Sequence[int], slope: float) -> float:
    """Return by how much neighbours that resemble each other widen the variance: at least 1."""
    rest = [low - slope * number for number, low in zip(numbers, lows, strict=True)]
    middle = median(rest)
    rest = [one - middle for one in rest]
    power = sum(one * one for one in rest)
    if power == 0:
        return 1.0
    likeness = sum(one * after for one, after in pairwise(rest)) / power
    likeness = min(max(likeness, 0.0), 0.99)
    return min(WIDER_MAX, (1 + likeness) / (1 - likeness))
