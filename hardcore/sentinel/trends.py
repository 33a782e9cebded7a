"""What one resource does over hours: its lowest values, kept on three scales, and when it would run out.

Each look goes into the open stretch, of which only the lowest and the highest value are kept: what garbage collection
leaves tells of a leak, what lies above it is work. Stretches are kept one by one for the last hour, by fives for six
hours and by thirties for two days, so a leak of megabytes a minute and one of megabytes an hour are both seen,
in memory that has a bound. Each scale gives its own slope, counted only when one of its stretches ends; the level is always that of
the last minutes. A claim is made where the *lower* bound of a slope, on top of the highest values as they usually
are, reaches the limit within the horizon, and is told once it has stood for a while. A model with seasons was not
chosen: it would have to be taught, and a household's days are not alike.
"""

from collections import deque
from collections.abc import Sequence
from statistics import median

import msgspec

from hardcore.sentinel.trends_slope import (
    POINTS_MIN,
    Points,
    Slope,
    growth,
    has_left,
    may_grow,
    swing,
)

#: How many stretches make one of each scale, and how many of these are kept.
SCALES = ((1, 60), (5, 72), (30, 96))
#: The level is the middle of so many last stretches.
LEVEL_STRETCHES = 3
#: The least noise that is believed, as a share of the limit: a value that stands still is not told to the byte.
NOISE_SHARE = 0.0005
#: Growth that would take longer than this to reach the limit is called none.
FAR_STRETCHES = 1 << 20


class Scale(msgspec.Struct):
    """Stretches of one length, the oldest first: number, lowest, highest, load of each. `slope`: as it was when the
    last one ended; `left`: the values have left where they began.
    """

    size: int
    kept_max: int
    numbers: deque[int] = msgspec.field(default_factory=deque)
    lows: deque[int] = msgspec.field(default_factory=deque)
    highs: deque[int] = msgspec.field(default_factory=deque)
    loads: deque[int] = msgspec.field(default_factory=deque)
    slope: Slope | None = None
    left: bool = False

    def add(self, number: int, low: int, high: int, load: int) -> bool:
        """Take in one stretch of the finest scale; return whether one of this scale has ended by it."""
        mine = number // self.size
        if self.numbers and self.numbers[-1] == mine:
            self.lows[-1] = min(self.lows[-1], low)
            self.highs[-1] = max(self.highs[-1], high)
            self.loads[-1] += load
        else:
            parts = ((self.numbers, mine), (self.lows, low), (self.highs, high), (self.loads, load))
            for kept, value in parts:
                kept.append(value)
                if len(kept) > self.kept_max:
                    kept.popleft()
        return (number + 1) % self.size == 0

    def judge(self, limit: int, horizon: float) -> None:
        """Find out how fast it grows, if it may grow fast enough to reach the limit within so many stretches."""
        lows = tuple(self.lows)
        self.left = has_left(lows, limit * NOISE_SHARE)
        needed = max(0, limit - max(self.highs)) / horizon
        self.slope = growth(self.points()) if self.left and may_grow(lows, needed) else None

    def swing(self) -> int:
        """Return how far the highest values lie above the lowest, as a rule."""
        return swing(self.points())

    def top(self, slope: Slope) -> float:
        """Return where the highest values are by now, as a rule: the last stretch that has ended lies behind."""
        return median(tuple(self.lows)[-LEVEL_STRETCHES:]) + slope.low + self.swing()

    def points(self) -> Points:
        """Return what is kept as plain rows."""
        return Points(tuple(self.numbers), tuple(self.lows), tuple(self.highs), tuple(self.loads))


class Claim(msgspec.Struct, frozen=True):
    """When the limit is reached, in stretches from now: by the slope, and by its lower bound. Levels as they were seen.

    `slope` is for each stretch; `swing` is what lies above the lowest values as a rule; `scale` is how many stretches a point had.
    """

    level: int
    swing: int
    slope: Slope
    due: float
    due_late: float
    scale: int


class Track(msgspec.Struct):
    """One resource of one life. `step_ns`: how long a stretch is. Nothing before `from_ns` counts."""

    step_ns: int
    from_ns: int = 0
    number: int | None = None  # of the open stretch
    low: int = 0
    high: int = 0
    done: int = 0  # what was done when it began
    claim: Claim | None = None
    since_ns: int | None = None  # since when a claim has stood
    gone_ns: int | None = None  # since when none has stood
    told: bool = False
    scales: tuple[Scale, ...] = msgspec.field(
        default_factory=lambda: tuple(Scale(size, kept_max) for size, kept_max in SCALES)
    )

    def look(self, at_ns: int, value: int, done: int, limit: int, horizon_ns: int) -> bool:
        """Note a value, and how much was done so far; return whether a stretch has ended by it."""
        if at_ns < self.from_ns:
            return False
        number = at_ns // self.step_ns
        ended = self.number is not None and number > self.number
        if ended:
            self._end(max(0, done - self.done), limit, horizon_ns)
            self.since_ns = None if self.claim is None else self.since_ns or at_ns
        if self.number is None or ended:
            self.number, self.low, self.high, self.done = number, value, value, done
        else:
            self.low, self.high = min(self.low, value), max(self.high, value)
        return ended

    @property
    def level(self) -> int | None:
        """The middle of the last lowest values; None: nothing was seen for a whole stretch yet."""
        lows = self.scales[0].lows
        last = [lows[-back] for back in range(1, min(LEVEL_STRETCHES, len(lows)) + 1)]
        return int(median(last)) if last else None

    def outlook(self, limit: int) -> Claim | None:
        """Return when the limit would be reached, however late: what the slopes say without any horizon."""
        slopes = [growth(scale.points()) if scale.left else None for scale in self.scales]
        return self._claim(limit, FAR_STRETCHES, slopes)

    def _end(self, load: int, limit: int, horizon_ns: int) -> None:
        assert self.number is not None, "a stretch is open"
        horizon = horizon_ns / self.step_ns
        for scale in self.scales:
            if scale.add(self.number, self.low, self.high, load) and len(scale.lows) >= POINTS_MIN:
                scale.judge(limit, horizon / scale.size)
        self.claim = self._claim(limit, horizon, [scale.slope for scale in self.scales])

    def _claim(self, limit: int, horizon: float, slopes: Sequence[Slope | None]) -> Claim | None:
        """Return the earliest claim of any scale within so many stretches."""
        level = self.level
        if level is None:
            return None
        above, found = self.scales[0].swing(), []
        for scale, slope in zip(self.scales, slopes, strict=True):
            if slope is None or slope.low <= 0:
                continue
            top = max(level + above, scale.top(slope))
            late = max(0.0, limit - top) * scale.size / slope.low
            if late <= horizon:
                due = max(0.0, limit - top) * scale.size / slope.middle
                found.append(Claim(level, int(top - level), slope, due, late, scale.size))
        return min(found, key=lambda claim: claim.due_late, default=None)


def tell(track: Track, now_ns: int, confirm_ns: int) -> bool:
    """Return whether a forecast is to be told now: it has stood for long enough, and was not told before.

    One that was told and does not stand any more is forgotten once it has been gone for as long.
    """
    if track.claim is None:
        track.gone_ns = track.gone_ns or now_ns
        track.told = track.told and now_ns - track.gone_ns < confirm_ns
        return False
    track.gone_ns = None
    assert track.since_ns is not None, "a claim stands since a moment"
    if track.told or now_ns - track.since_ns < confirm_ns:
        return False
    track.told = True
    return True
