"""Traces of resources, made from seeds: what leaks look like, and what only looks like one.

Each trace is what a watch would have seen, every ten seconds: a value and how much was asked of the process since the
one before. A leak ends when its highest value reaches the limit; whoever judges it has to have said so before. What is
healthy stays below nine tenths of the limit, because above that even a person would ask. Recordings of real programs
were not chosen: there are none of ours that run for a thousand hours, and others' may not be kept here.
"""

import math
import random
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import count

STEP_S = 10
MIB = 1 << 20
LIMIT_BYTES = 512 * MIB
#: A leak that has not reached the limit by then is left out: nobody would wait for the end of it.
HOURS_MAX = 96
HEALTHY_SHARE = 0.9

Value = Callable[[float], float]


@dataclass(frozen=True, slots=True)
class Trace:
    """One trace: `values` and `loads` every STEP_S, against `limit`. `leaks`: it ends because the limit is reached."""

    kind: str
    leaks: bool
    limit: int
    values: tuple[int, ...]
    loads: tuple[int, ...]

    @property
    def hours(self) -> float:
        """How long it is."""
        return len(self.values) * STEP_S / 3600


def healthy(seed: int) -> Trace:
    """Return a trace of a process that is well, of some kind, half a day to two days long."""
    dice = random.Random(f"healthy {seed}")
    kind = dice.choice(sorted(_HEALTHY))
    hours = dice.uniform(12, 48)
    values, loads = _HEALTHY[kind](dice, int(hours * 3600 / STEP_S))
    most, room = max(values), HEALTHY_SHARE * LIMIT_BYTES
    scale = min(1.0, room / most)
    return Trace(kind, False, LIMIT_BYTES, tuple(int(one * scale) for one in values), tuple(loads))


def leak(seed: int) -> Trace:
    """Return a trace of a process that leaks, of some kind and rate, up to the moment when the limit is reached."""
    for turn in range(100):
        dice = random.Random(f"leak {seed} {turn}")
        kind = dice.choice(sorted(_LEAKS))
        made = _LEAKS[kind](dice)
        if made is not None:
            values, loads, limit = made
            return Trace(kind, True, limit, values, loads)
    raise AssertionError("one in a hundred leaks reaches its limit")


# ---- what is healthy ----


def _even_load(dice: random.Random) -> Iterator[int]:
    mean = math.exp(dice.uniform(math.log(0.05), math.log(200)))  # in one step of ten seconds
    while True:
        yield _poisson(dice, mean)


def _poisson(dice: random.Random, mean: float) -> int:
    if mean > 30:
        return max(0, round(dice.gauss(mean, math.sqrt(mean))))
    limit, product, count = math.exp(-mean), dice.random(), 0
    while product > limit:
        product *= dice.random()
        count += 1
    return count


def _noise(dice: random.Random, sigma: float) -> Iterator[float]:
    """Noise with a memory of some minutes: an allocator gives back late."""
    stays = dice.uniform(0.5, 0.995)
    state = 0.0
    while True:
        state = stays * state + dice.gauss(0, sigma * math.sqrt(1 - stays * stays))
        yield state


def _base(dice: random.Random) -> float:
    return dice.uniform(80, 300) * MIB


def _flat(dice: random.Random, count: int) -> tuple[list[float], list[int]]:
    base, noise, load = _base(dice), _noise(dice, dice.uniform(0.2, 12) * MIB), _even_load(dice)
    return [base + next(noise) for _ in range(count)], [next(load) for _ in range(count)]


def _saw(dice: random.Random) -> Value:
    """Garbage that is collected: every minute, or every few hours."""
    period_s = math.exp(dice.uniform(math.log(40), math.log(4 * 3600)))
    height = dice.uniform(5, 150) * MIB
    early = dice.uniform(0, period_s)
    return lambda at_s: height * ((at_s + early) % period_s) / period_s


def _sawtooth(dice: random.Random, count: int) -> tuple[list[float], list[int]]:
    values, loads = _flat(dice, count)
    saw = _saw(dice)
    return [value + saw(step * STEP_S) for step, value in enumerate(values)], loads


def _warm_up(dice: random.Random, count: int) -> tuple[list[float], list[int]]:
    values, loads = _flat(dice, count)
    rise, half_s = dice.uniform(30, 250) * MIB, dice.uniform(3, 60) * 60
    return [
        value + rise * (1 - math.exp(-step * STEP_S / half_s)) for step, value in enumerate(values)
    ], loads


def _cache(dice: random.Random, count: int) -> tuple[list[float], list[int]]:
    """A cache that fills in a straight line until it is full."""
    values, loads = _flat(dice, count)
    rise, takes_s = dice.uniform(20, 200) * MIB, dice.uniform(0.5, 12) * 3600
    begins_s = dice.uniform(0, 6) * 3600
    return [
        value + rise * min(1.0, max(0.0, step * STEP_S - begins_s) / takes_s)
        for step, value in enumerate(values)
    ], loads


def _wave(dice: random.Random) -> Value:
    early, depth = dice.uniform(0, 86_400), dice.uniform(0.3, 0.9)
    return lambda at_s: 1 + depth * math.sin(2 * math.pi * (at_s + early) / 86_400)


def _day(dice: random.Random, count: int) -> tuple[list[float], list[int]]:
    values, _ = _flat(dice, count)
    wave, each = _wave(dice), dice.uniform(20, 120) * MIB
    mean = dice.uniform(0.5, 200)
    loads = [_poisson(dice, mean * wave(step * STEP_S)) for step in range(count)]
    return [value + each * wave(step * STEP_S) for step, value in enumerate(values)], loads


def _steps_of_load(dice: random.Random, count: int) -> tuple[list[float], list[int]]:
    """The load changes at once, now and then; memory follows within minutes."""
    values, loads = _flat(dice, count)
    mean, level, follows, at = dice.uniform(2, 100), 1.0, 0.0, 0
    each, slow = dice.uniform(20, 100) * MIB, dice.uniform(0.9, 0.995)
    for step in range(count):
        if step == at:
            level, at = dice.uniform(0.2, 3), step + dice.randrange(60, 3_000)
        follows = slow * follows + (1 - slow) * level
        values[step] += each * follows
        loads[step] = _poisson(dice, mean * level)
    return values, loads


def _batch(dice: random.Random, count: int) -> tuple[list[float], list[int]]:
    """An import of up to an hour, a few times a day: memory grows while it lasts and is given back, or kept."""
    values, loads = _flat(dice, count)
    kept, rise = 0.0, dice.uniform(20, 160) * MIB
    begins, stays = dice.randrange(360), dice.choice((0.0, 0.0, 0.3, 1.0))
    ends = begins + dice.randrange(60, 360)
    for step in range(count):
        if step >= ends:
            begins, kept = step + dice.randrange(720, 4_000), max(kept, stays * rise)
            ends = begins + dice.randrange(60, 360)
        share = max(0.0, (step - begins) / (ends - begins))
        values[step] += max(kept, rise * share)
        loads[step] += dice.randrange(50, 150) if share else 0
    return values, loads


def _backup(dice: random.Random, count: int) -> tuple[list[float], list[int]]:
    """Once a night something runs for ten minutes to an hour, nobody has asked for it, and it is over."""
    values, loads = _flat(dice, count)
    rise, long, at = dice.uniform(10, 120) * MIB, dice.randrange(60, 360), dice.randrange(4_000)
    for step in range(count):
        into = (step - at) % 8_640
        if step >= at and into < long:
            values[step] += rise * min(1.0, 3 * into / long)
    return values, loads


def _wander(dice: random.Random, count: int) -> tuple[list[float], list[int]]:
    """It wanders without an aim, between walls."""
    values, loads = _flat(dice, count)
    at, walls, pace = 0.0, dice.uniform(10, 80) * MIB, dice.uniform(0.02, 0.6) * MIB
    for step in range(count):
        at = min(walls, max(-walls, at + dice.gauss(0, pace)))
        values[step] += at + walls
    return values, loads


_Made = tuple[list[float], list[int]]
_HEALTHY: Mapping[str, Callable[[random.Random, int], _Made]] = {
    "flat": _flat,
    "sawtooth": _sawtooth,
    "warm-up": _warm_up,
    "cache": _cache,
    "day": _day,
    "load steps": _steps_of_load,
    "batch": _batch,
    "backup": _backup,
    "wander": _wander,
}

# ---- what leaks ----

_Leaked = tuple[tuple[int, ...], tuple[int, ...], int] | None


def _rate(dice: random.Random) -> float:
    """Bytes in a second: from five to three hundred MiB in an hour."""
    return math.exp(dice.uniform(math.log(5), math.log(300))) * MIB / 3600


def _until(limit: int, values: Iterator[float], loads: Iterator[int]) -> _Leaked:
    seen, asked = [], []
    for _ in range(HOURS_MAX * 3600 // STEP_S):
        value = next(values)
        seen.append(int(value))
        asked.append(next(loads))
        if value >= limit:
            return tuple(seen), tuple(asked), limit
    return None


def _leaking(
    dice: random.Random, grown: Value, over: Value | None = None, loads: Iterator[int] | None = None
) -> _Leaked:
    base, noise = _base(dice), _noise(dice, dice.uniform(0.2, 8) * MIB)

    def values() -> Iterator[float]:
        step = 0
        while True:
            at_s = step * STEP_S
            yield base + grown(at_s) + next(noise) + (over(at_s) if over else 0)
            step += 1

    return _until(LIMIT_BYTES, values(), loads or _even_load(dice))


def _steady(dice: random.Random) -> _Leaked:
    rate = _rate(dice)
    return _leaking(dice, lambda at_s: rate * at_s)


def _late(dice: random.Random) -> _Leaked:
    rate, begins_s = _rate(dice), dice.uniform(1, 24) * 3600
    return _leaking(dice, lambda at_s: rate * max(0.0, at_s - begins_s))


def _by_steps(dice: random.Random) -> _Leaked:
    rate, each = _rate(dice), dice.uniform(2, 40) * MIB
    long_s = min(2_400.0, each / rate)
    return _leaking(dice, lambda at_s: rate * long_s * (at_s // long_s))


def _under_saw(dice: random.Random) -> _Leaked:
    rate = _rate(dice)
    period_s = math.exp(dice.uniform(math.log(40), math.log(3600)))
    height = dice.uniform(5, 80) * MIB
    return _leaking(dice, lambda at_s: rate * at_s, lambda at_s: height * (at_s % period_s) / period_s)


def _by_request(dice: random.Random) -> _Leaked:
    """Each request leaves something; there are more of them by day."""
    wave, mean = _wave(dice), dice.uniform(1, 100)
    each = _rate(dice) * STEP_S / mean
    base, noise = _base(dice), _noise(dice, dice.uniform(0.2, 8) * MIB)
    loads: list[int] = []

    def values() -> Iterator[float]:
        held, step = base, 0
        while True:
            loads.append(_poisson(dice, mean * wave(step * STEP_S)))
            held += each * loads[-1]
            step += 1
            yield held + next(noise)

    return _until(LIMIT_BYTES, values(), iter(lambda: loads[-1], None))


def _counted(dice: random.Random, limit: int, base: int, most: int) -> _Leaked:
    """Descriptors, or threads: whole numbers, few at a time."""
    rate = math.exp(dice.uniform(math.log(limit / 48), math.log(limit / 1.5))) / 3600
    busy = dice.randrange(1, most)

    def values() -> Iterator[float]:
        step = 0
        while True:
            yield base + int(rate * step * STEP_S) + dice.randrange(busy + 1)
            step += 1

    return _until(limit, values(), _even_load(dice))


def _fds(dice: random.Random) -> _Leaked:
    return _counted(dice, 1024, 40, 30)


def _threads(dice: random.Random) -> _Leaked:
    return _counted(dice, 256, 14, 8)


# ---- what leaks at one rate, whatever is asked of it: the load is what may hide it ----

Loads = Callable[[random.Random], Iterator[int]]


def _under(loads: Loads) -> Callable[[random.Random], _Leaked]:
    def made(dice: random.Random) -> _Leaked:
        rate = _rate(dice)
        return _leaking(dice, lambda at_s: rate * at_s, loads=loads(dice))

    return made


def _load_of_days(dice: random.Random) -> Iterator[int]:
    wave, mean = _wave(dice), dice.uniform(0.5, 100)
    return (_poisson(dice, mean * wave(step * STEP_S)) for step in count())


def _load_by_steps(dice: random.Random) -> Iterator[int]:
    mean = dice.uniform(2, 100)
    while True:
        level = dice.uniform(0.2, 3)
        for _ in range(dice.randrange(60, 3_000)):
            yield _poisson(dice, mean * level)


def _load_in_batches(dice: random.Random) -> Iterator[int]:
    usual = _even_load(dice)
    while True:
        for _ in range(dice.randrange(720, 4_000)):
            yield next(usual)
        for _ in range(dice.randrange(60, 360)):
            yield next(usual) + dice.randrange(50, 150)


def _load_with_a_tail(dice: random.Random) -> Iterator[int]:
    """Another level every five minutes, now and then a hundred times the usual."""
    middle, wide = dice.uniform(0, 3), dice.uniform(0.7, 1.5)
    while True:
        level = math.exp(dice.gauss(middle, wide))
        for _ in range(30):
            yield _poisson(dice, level)


def _load_of_a_household(dice: random.Random) -> Iterator[int]:
    """Nothing by night, and by day now and then something, seldom much at once."""
    begins_h = dice.uniform(0, 24)
    for step in count():
        awake = 7 <= (begins_h + step * STEP_S / 3600) % 24 <= 23
        yield int(dice.paretovariate(1.1)) if awake and dice.random() < 0.3 else 0


def _under_days(dice: random.Random) -> _Leaked:
    """The memory follows the load of the day as well."""
    rate, wave, each = _rate(dice), _wave(dice), dice.uniform(20, 80) * MIB
    mean = dice.uniform(0.5, 100)
    loads = (_poisson(dice, mean * wave(step * STEP_S)) for step in count())
    return _leaking(dice, lambda at_s: rate * at_s, lambda at_s: each * wave(at_s), loads)


_LEAKS: Mapping[str, Callable[[random.Random], _Leaked]] = {
    "steady": _steady,
    "late": _late,
    "by steps": _by_steps,
    "under a sawtooth": _under_saw,
    "by request": _by_request,
    "descriptors": _fds,
    "threads": _threads,
    "steady, load of days": _under(_load_of_days),
    "steady, load by steps": _under(_load_by_steps),
    "steady, load in batches": _under(_load_in_batches),
    "steady, load with a heavy tail": _under(_load_with_a_tail),
    "steady, load of a household": _under(_load_of_a_household),
    "steady, memory and load of days": _under_days,
}
