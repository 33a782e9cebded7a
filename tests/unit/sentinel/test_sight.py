"""A core that can't be seen whole: it is said, it is never green, and it is ended on two kinds of evidence or not."""

from collections.abc import Callable

import pytest
from msgspec.structs import replace

from hardcore.model.looks import DiskFacts, ThreadSample
from hardcore.model.observations import Probed, Sampled, Surveyed
from hardcore.model.verdicts import Colour, Diagnosis, Grade, Verdict
from hardcore.sentinel.verdict import Bench
from tests.unit.sentinel import traces
from tests.unit.sentinel.traces import MS, PATIENCE, Look, at_ns_of, red, well

LONG_MS = 30_000
REASON = "The recorder page's header was changed."


def _pageless(tick: Sampled) -> Sampled:
    return replace(tick, beats=None, witness=None, page_fault=REASON)


def _unseen(tick: Sampled) -> Sampled:
    return replace(tick, process=None, process_fault="/proc can't be read: Too many open files.")


def _from_the_future(tick: Sampled) -> Sampled:
    assert tick.beats is not None
    return replace(tick, beats=replace(tick.beats, loop_ns=1 << 62))


def _taken_back(tick: Sampled) -> Sampled:
    assert tick.beats is not None
    return replace(tick, beats=replace(tick.beats, loop_ns=0, thread_ns=0))


def _judged(
    like: Look,
    spoil: Callable[[Sampled], Sampled],
    *,
    answered: bool = False,
    probed: bool = True,
    disk: DiskFacts | None = None,
    every_ms: int = 100,
) -> list[Verdict]:
    """What is said from 1000 on, when `spoil` happens to each look; probed once a second, as it is surveyed."""
    bench = Bench(PATIENCE)
    for look in well(1000):
        bench.judge(look.sampled())
    said = []
    for at_ms in range(1000, LONG_MS, every_ms):
        if probed and at_ms % 1000 == 0 and at_ms >= 2000:
            bench.hear(Probed(at_ns_of(at_ms), 1, at_ns_of(at_ms - 1000), answered))
        if disk is not None and at_ms % 1000 == 0:
            bench.hear(Surveyed(at_ns_of(at_ms), 1, disk))
        said.append(bench.judge(spoil(replace(like, at_ms=at_ms).sampled())))
    return said


STOPPED = Look(0, state="T", loop=traces.STOPPED, quiet=True)


@pytest.mark.parametrize("spoil", [_pageless, _unseen, _from_the_future, _taken_back])
def test_what_can_not_be_seen_is_said_from_the_first_look_and_never_green(
    spoil: Callable[[Sampled], Sampled],
) -> None:
    assert {v.colour for v in _judged(Look(0), spoil, answered=True)} == {Colour.YELLOW}


def test_why_there_is_no_page_or_no_process_is_named() -> None:
    for spoil, witness, why in (
        (_pageless, "page", REASON),
        (_unseen, "process", "Too many open files"),
        (_from_the_future, "page", "from the future"),
        (_taken_back, "page", "taken back"),
    ):
        first = _judged(Look(0), spoil)[0]
        assert [t.witness for t in first.testimonies if why in t.why] == [witness]


def test_without_a_page_a_stopped_core_that_does_not_answer_is_frozen() -> None:
    verdict = red(_judged(STOPPED, _pageless))
    assert verdict is not None
    assert (verdict.diagnosis, verdict.grade) == (Diagnosis.FROZEN, Grade.LIKELY)
    assert {"page", "process", "probe"} <= {testimony.witness for testimony in verdict.testimonies}


@pytest.mark.parametrize("sleep", [traces.LOCKED, traces.NAPPING, traces.POLLING])
def test_without_a_page_a_loop_asleep_where_no_loop_rests_that_does_not_answer_is_blocked(
    sleep: ThreadSample,
) -> None:
    verdict = red(_judged(Look(0, loop=sleep), _pageless))
    assert verdict is not None
    assert (verdict.diagnosis, verdict.grade) == (Diagnosis.LOOP_BLOCKED, Grade.LIKELY)


def test_without_a_page_two_probes_must_be_silent_and_for_the_longer_time() -> None:
    verdicts = _judged(STOPPED, _pageless)
    first = [verdict.colour for verdict in verdicts].index(Colour.RED)
    assert first * 100 >= max(2 * 1000, PATIENCE.hang_ms)


@pytest.mark.parametrize("like", [STOPPED, Look(0, loop=traces.LOCKED)], ids=["stopped", "asleep"])
def test_a_core_without_a_page_that_answers_is_never_ended(like: Look) -> None:
    assert red(_judged(like, _pageless, answered=True)) is None
    assert red(_judged(like, _pageless, probed=False)) is None


@pytest.mark.parametrize("loop", [traces.EPOLL, traces.UNSCHEDULED, traces.ON_DISK, traces.GONE, None])
def test_silence_of_a_core_without_a_page_is_not_enough(loop: ThreadSample | None) -> None:
    assert red(_judged(Look(0, loop=loop), _pageless)) is None


def test_a_core_without_a_page_that_computes_is_never_ended() -> None:
    def computing(tick: Sampled) -> Sampled:
        assert tick.process is not None
        busy = replace(tick.process, state="R", loop=ThreadSample("R", tick.at_ns, ""))
        return replace(_pageless(tick), process=busy)

    assert red(_judged(Look(0), computing)) is None


def test_a_loop_without_a_page_that_waits_for_a_standing_disk_is_not_ended() -> None:
    standing = DiskFacts(1 << 34, read_only=False, write_ns=None, pending_ns=5000 * MS)
    assert red(_judged(Look(0, loop=traces.LOCKED), _pageless, disk=standing)) is None


@pytest.mark.parametrize("like", [STOPPED, Look(0, loop_age_ms=9000, thread_age_ms=9000)])
def test_a_process_that_nobody_can_look_at_is_never_ended(like: Look) -> None:
    assert red(_judged(like, _unseen)) is None


def test_a_guard_that_is_late_needs_as_many_looks_without_a_page() -> None:
    verdicts = _judged(STOPPED, _pageless, every_ms=250)
    first = [verdict.colour for verdict in verdicts].index(Colour.RED)
    assert first >= PATIENCE.hang_ms // PATIENCE.interval_ms


def test_a_page_that_is_there_again_is_judged_from_where_it_was_seen() -> None:
    bench = Bench(PATIENCE)
    for look in well(1000):
        bench.judge(look.sampled())
    looks = [Look(at, at - 1000, loop=traces.LOCKED) for at in range(1070, 3000, 100)]
    said = [bench.judge(_pageless(look.sampled())) for look in looks[:10]]
    said += [bench.judge(look.sampled()) for look in looks[10:]]
    assert [verdict.colour for verdict in said[:10]] == [Colour.YELLOW] * 10
    assert said[-1].diagnosis is Diagnosis.LOOP_BLOCKED


@pytest.mark.parametrize("spoil", [_pageless, _unseen])
def test_probes_that_were_silent_while_a_core_could_not_be_seen_are_not_held_against_a_loop_that_turns(
    spoil: Callable[[Sampled], Sampled],
) -> None:
    bench = Bench(PATIENCE)
    for look in well(1000):
        bench.judge(look.sampled())
    for at_ms in range(1000, 4000, 100):  # it is not scheduled
        if at_ms in {2000, 3000, 3900}:
            bench.hear(Probed(at_ns_of(at_ms), 1, at_ns_of(at_ms - 800), answered=False))
        bench.judge(spoil(Look(at_ms, at_ms - 1000, at_ms - 1000, loop=traces.UNSCHEDULED).sampled()))
    assert [bench.judge(look.sampled()).colour for look in (Look(4000), Look(4100))] == [Colour.GREEN] * 2
