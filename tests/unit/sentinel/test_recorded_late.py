"""The judge over what real processes looked like, as a guard would have met them that was kept from looking.

The recordings are those of `test_recorded.py`. A guard that is late has only some of their looks; a machine that was
paused has all of them, with a hole in the time.
"""

import functools
from collections.abc import Iterable, Iterator
from random import Random
from typing import TypeVar

import pytest
from msgspec.structs import fields, replace

from hardcore.model.observations import Sampled, StacksSampled
from hardcore.model.recorder import Beats, CommandNote
from hardcore.model.verdicts import Colour, Diagnosis, Verdict
from hardcore.sentinel.verdict import Bench
from tests.unit.sentinel import recordings
from tests.unit.sentinel.recordings import Fact
from tests.unit.sentinel.test_recorded import HEALTHY
from tests.unit.sentinel.traces import MS, PATIENCE

PAUSED_NS = 30_000 * MS
T = TypeVar("T", Beats, CommandNote)
#: Faults that last long enough in their recording for a guard that makes three looks of five.
FOUND = {
    "block": Diagnosis.LOOP_BLOCKED,
    "gil_asleep": Diagnosis.GIL_HELD,
    "slow_transaction": Diagnosis.TRANSACTION_TIMEOUT,
    "deadlock": Diagnosis.TRANSACTION_TIMEOUT,
    "stop_long": Diagnosis.FROZEN,
}


@functools.cache
def _facts(name: str) -> tuple[Fact, ...]:
    return tuple(recordings.read(name))


def _judged(facts: Iterable[Fact]) -> list[Verdict]:
    bench, said = Bench(PATIENCE), []
    for fact in facts:
        if isinstance(fact, StacksSampled):
            bench.hear(fact)
        else:
            said.append(bench.judge(fact))
    return said


def _some(name: str, every: int, first: int) -> Iterator[Fact]:
    """Every so many looks."""
    for n, fact in enumerate(_facts(name)):
        if isinstance(fact, StacksSampled) or n % every == first:
            yield fact


def _fewer(name: str, seed: int) -> Iterator[Fact]:
    """Looks left out at random, now one, now many in a row."""
    rng, out = Random(seed), 0
    for fact in _facts(name):
        if isinstance(fact, StacksSampled):
            yield fact
        elif out:
            out -= 1
        else:
            yield fact
            out = rng.choice((0, 0, 0, 1, 2, 2, 3, 9))


def _paused(name: str, at: int) -> Iterator[Fact]:
    """As if the whole machine had stood still just after the look number `at`."""
    since_ns = 0
    for n, fact in enumerate(_facts(name)):
        if not since_ns:
            yield fact
            since_ns = fact.at_ns if n >= at else 0
        elif isinstance(fact, StacksSampled):
            yield replace(fact, at_ns=fact.at_ns + PAUSED_NS)
        else:
            yield _later(fact, since_ns)


def _later(tick: Sampled, since_ns: int) -> Sampled:
    assert tick.beats is not None
    notes = None if tick.in_flight is None else tuple(_moved(note, since_ns) for note in tick.in_flight)
    beats = _moved(tick.beats, since_ns)
    return replace(tick, at_ns=tick.at_ns + PAUSED_NS, beats=beats, in_flight=notes, clocks=None)


def _moved(thing: T, since_ns: int) -> T:
    """Its times after that moment, as much later as the machine stood still."""
    times = {f.name: getattr(thing, f.name) for f in fields(thing) if f.name.endswith("_ns")}
    return replace(thing, **{name: at + PAUSED_NS for name, at in times.items() if at > since_ns})


@pytest.mark.parametrize("name", HEALTHY)
@pytest.mark.parametrize("every", [2, 3, 5, 10])
def test_a_guard_that_is_always_late_ends_nobody_who_only_looks_ill(name: str, every: int) -> None:
    for first in range(every):
        assert Colour.RED not in {verdict.colour for verdict in _judged(_some(name, every, first))}


@pytest.mark.parametrize("name", HEALTHY)
def test_a_guard_that_is_late_now_and_then_ends_nobody_who_only_looks_ill(name: str) -> None:
    for seed in range(10):
        assert Colour.RED not in {verdict.colour for verdict in _judged(_fewer(name, seed))}, seed


@pytest.mark.parametrize("name", HEALTHY)
def test_a_machine_that_was_paused_ends_nobody_who_only_looks_ill(name: str) -> None:
    for at in range(1, len(_facts(name)) - 1, 4):
        assert Colour.RED not in {verdict.colour for verdict in _judged(_paused(name, at))}, at


@pytest.mark.parametrize(("name", "diagnosis"), FOUND.items())
def test_a_guard_that_is_late_again_and_again_finds_a_hang_all_the_same(
    name: str, diagnosis: Diagnosis
) -> None:
    looks = [fact for fact in _facts(name) if isinstance(fact, Sampled)]
    said = _judged(tick for n, tick in enumerate(looks) if n % 5 not in {3, 4})
    assert diagnosis in {verdict.diagnosis for verdict in said if verdict.colour is Colour.RED}
