"""How long an outage usually lasts: two numbers out of those that are over, or none.

An order statistic, because it promises what it says: with n outages behind us, the k-th smallest of them holds
the next one with a chance of k in n+1, whatever the shape of the times. It is asked again at each stage, of
what was left when earlier outages had come this far, so that causes that differ only in how they begin are
counted together. The two ways to a core are not: a spare takes over in a tenth of the time of a cold start, and
pooled they would promise something that is true of neither. What was promised is kept beside what came, so that the
promise itself can be judged. Means and interpolated percentiles were tried: they promised too little or too much.
"""

from collections.abc import Sequence
from enum import StrEnum

import msgspec

#: Outages that are remembered of each way; older ones say little about this machine.
SAMPLES_MAX = 50
#: Below this many nothing is promised.
SAMPLES_MIN = 5
#: From this many on the bound is one of them; before it, the longest and half of it again.
BOUND_MIN = 9

STAGES = 4


class Way(StrEnum):
    """How the next core came to serve."""

    COLD = "cold"  # it was started
    SPARE = "spare"  # it stood ready and took over


class Told(msgspec.Struct, frozen=True):
    """A range as people are told it, in whole seconds."""

    low_s: int
    high_s: int


class Sample(msgspec.Struct, frozen=True):
    """One outage that is over: how long it was, and how long it had lasted when each stage was reached.

    `reached_ms` has one number for each stage, 1 to 4; a stage that was passed over has that of the next. `told` is
    what people were promised meanwhile, at its narrowest; None: nothing.
    """

    total_ms: int
    reached_ms: tuple[int, int, int, int]
    way: Way = Way.COLD
    told: Told | None = None

    @property
    def within(self) -> bool:
        """Whether it was over by the time that was told. An end sooner than usual breaks no promise."""
        return self.told is not None and self.total_ms <= self.told.high_s * 1000


class Score(msgspec.Struct, frozen=True):
    """How good the promises were: outages remembered, those of them with a promise, those that kept it."""

    samples: int
    scored: int
    within: int


class Range(msgspec.Struct, frozen=True):
    """What an outage usually lasts, from its begin: at the middle, and at most nine times in ten."""

    low_ms: int
    high_ms: int


def sample(
    total_ms: int, reached: Sequence[tuple[int, int]], way: Way = Way.COLD, told: Told | None = None
) -> Sample:
    """The sample of an outage that reached each `(stage, ms)` of `reached`, in this order."""

    def at(stage: int) -> int:
        later = (ms for number, ms in reached if number >= stage)
        return 0 if stage == 1 else min(total_ms, next(later, total_ms))

    return Sample(total_ms, (at(1), at(2), at(3), at(4)), way, told)


def of_way(samples: Sequence[Sample], way: Way) -> tuple[Sample, ...]:
    """Those outages that were ended this way."""
    return tuple(one for one in samples if one.way is way)


def youngest(samples: Sequence[Sample]) -> tuple[Sample, ...]:
    """What is remembered: the last of each way, so that many of one do not push out the few of the other."""
    places, kept = dict.fromkeys(Way, SAMPLES_MAX), []
    for one in reversed(samples):
        if places[one.way]:
            places[one.way] -= 1
            kept.append(one)
    return tuple(reversed(kept))


def score(samples: Sequence[Sample]) -> Score:
    """How the promises that were made of these outages came true."""
    promised = [one for one in samples if one.told is not None]
    return Score(len(samples), len(promised), sum(one.within for one in promised))


def bound(values: Sequence[int]) -> int:
    """A number that the next value stays under, nine times in ten. There is at least one value."""
    ordered = sorted(values)
    count = len(ordered)
    if count < BOUND_MIN:
        return ordered[-1] * 3 // 2
    return ordered[-(-(count + 1) * 9 // 10) - 1]


def middle(values: Sequence[int]) -> int:
    """The lower of the values in the middle. There is at least one."""
    return sorted(values)[(len(values) - 1) // 2]


def estimate(samples: Sequence[Sample], stage: int, reached_ms: int) -> Range | None:
    """How long an outage lasts in all that reached `stage` after `reached_ms`; None: too few samples."""
    if len(samples) < SAMPLES_MIN:
        return None
    left = [one.total_ms - one.reached_ms[stage - 1] for one in samples]
    return Range(reached_ms + middle(left), reached_ms + bound(left))


def narrowed(told: Told | None, newer: Told | None) -> Told | None:
    """What may be told after `told`: neither number ever grows, because nobody believes one that does.

    It is the seconds that are narrowed, because they are what was said: rounded anew in finer steps, the lower
    number of a shorter range could be the greater one.
    """
    if told is None or newer is None:
        return told or newer
    return Told(min(told.low_s, newer.low_s), min(told.high_s, newer.high_s))


def in_seconds(meant: Range) -> Told:
    """The two numbers as people are told them: apart, rounded outwards, coarser the longer."""
    low, high = meant.low_ms // 1000, -(-meant.high_ms // 1000)
    step = 1 if high < 10 else 5 if high < 60 else 15
    low, high = low // step * step, -(-high // step) * step
    return Told(low, max(high, low + step))
