import pytest
from msgspec.structs import replace

from hardcore.model.looks import ThreadSample
from hardcore.model.observations import Sampled
from hardcore.model.recorder import SlotStage
from hardcore.model.verdicts import GREEN, Colour, Diagnosis, Grade
from hardcore.sentinel.verdict import Bench
from tests.unit.sentinel import traces
from tests.unit.sentinel.traces import (
    BEGAN_MS,
    MS,
    PATIENCE,
    Look,
    deciding_since,
    judged,
    queued,
    red,
    silent,
    well,
)

WELL = well(1000)


def test_a_healthy_core_is_green_all_the_time() -> None:
    assert set(judged(well(5000))) == {GREEN}


# What is a hang.


def test_a_core_that_stays_stopped_is_frozen() -> None:
    verdict = red(judged(WELL + silent(1000, 900, Look(0, state="T", loop=traces.STOPPED), thread=True)))
    assert verdict is not None
    assert (verdict.diagnosis, verdict.grade) == (Diagnosis.FROZEN, Grade.CERTAIN)
    assert verdict.fault_ns == (BEGAN_MS + 1000) * MS


@pytest.mark.parametrize("sleep", [traces.NAPPING, traces.LOCKED], ids=["nanosleep", "futex"])
def test_a_loop_asleep_on_a_timer_or_a_lock_is_blocked(sleep: ThreadSample) -> None:
    verdict = red(judged(WELL + silent(1000, 900, Look(0, loop=sleep))))
    assert verdict is not None
    assert (verdict.diagnosis, verdict.grade) == (Diagnosis.LOOP_BLOCKED, Grade.CERTAIN)


def test_a_loop_asleep_in_another_wait_is_given_more_time() -> None:
    looks = WELL + silent(1000, 2400, Look(0, loop=traces.POLLING))
    verdicts = judged(looks)
    verdict = red(verdicts)
    assert verdict is not None
    assert (verdict.diagnosis, verdict.grade) == (Diagnosis.LOOP_BLOCKED, Grade.LIKELY)
    first = looks[[v.colour for v in verdicts].index(Colour.RED)]
    assert first.loop_age_ms > PATIENCE.hang_ms


def test_a_loop_that_is_over_in_a_process_kept_alive_by_idle_threads_is_blocked() -> None:
    looks = WELL + silent(1000, 2400, Look(0, loop=traces.LOCKED, quiet=True), thread=True)
    verdicts = judged(looks)
    verdict = red(verdicts)
    assert verdict is not None
    assert (verdict.diagnosis, verdict.grade) == (Diagnosis.LOOP_BLOCKED, Grade.LIKELY)
    assert looks[[v.colour for v in verdicts].index(Colour.RED)].loop_age_ms > PATIENCE.hang_ms


def test_commands_that_wait_for_a_writer_that_is_gone_make_no_progress() -> None:
    looks = [Look(at, submitted=2, writer=traces.GONE, notes=queued(0, 0)) for at in range(0, 4000, 100)]
    verdict = red(judged(looks))
    assert verdict is not None
    assert (verdict.diagnosis, verdict.grade) == (Diagnosis.NO_PROGRESS, Grade.CERTAIN)


def test_commands_that_wait_for_a_writer_that_sleeps_make_no_progress() -> None:
    verdict = red(judged([Look(at, submitted=2, notes=queued(0, 0)) for at in range(0, 4000, 100)]))
    assert verdict is not None
    assert (verdict.diagnosis, verdict.grade) == (Diagnosis.NO_PROGRESS, Grade.LIKELY)


def test_a_red_verdict_carries_what_every_witness_said() -> None:
    verdict = red(judged(WELL + silent(1000, 900, Look(0, loop=traces.NAPPING))))
    assert verdict is not None
    assert {testimony.witness for testimony in verdict.testimonies} == {"beats", "process", "progress"}


# What is none, however long it lasts.

LONG_MS = 20_000


@pytest.mark.parametrize("stop_ms", [100, 200, 300])
def test_a_short_stop_that_heals_is_no_hang(stop_ms: int) -> None:
    stopped = silent(1000, stop_ms, Look(0, state="T", loop=traces.STOPPED), thread=True)
    verdicts = judged(WELL + stopped + [Look(at) for at in range(1000 + stop_ms + 70, 2500, 100)])
    assert red(verdicts) is None
    assert verdicts[-1] is GREEN


def test_a_stop_of_a_moment_after_a_long_stall_is_no_hang() -> None:
    starved = silent(1000, 3000, Look(0, state="R", loop=traces.UNSCHEDULED), thread=True)
    stopped = [Look(at, at - 1000, at - 1000, state="T", loop=traces.STOPPED) for at in (4070, 4170, 4270)]
    assert red(judged(WELL + starved + stopped + [Look(4370)])) is None


def test_a_nap_of_a_moment_after_a_long_computation_is_no_hang() -> None:
    looks = [Look(at, at - 1000, loop=traces.running(at), state="R") for at in range(1070, 2170, 100)]
    nap = [Look(at, at - 1000, loop=traces.NAPPING) for at in (2170, 2270, 2370, 2470)]
    assert red(judged(WELL + looks + nap + [Look(2570)])) is None


def test_a_disk_wait_never_kills() -> None:
    looks = WELL + silent(1000, LONG_MS, Look(0, state="D", loop=traces.ON_DISK))
    assert red(judged(looks)) is None


def test_an_interpreter_held_in_a_sleep_never_kills_while_nobody_sees_that_others_wait_for_it() -> None:
    # The thread of the beats was not looked at: that the loop wakes up now and then proves nothing.
    held = silent(1000, LONG_MS, Look(0, quiet=True), thread=True)
    looks = [replace(look, loop=replace(traces.LOCKED, cpu_ns=look.at_ms)) for look in held]
    assert red(judged(WELL + looks)) is None


@pytest.mark.parametrize("loop", [traces.ON_DISK, traces.EPOLL, traces.UNSCHEDULED, traces.GONE])
def test_two_silent_beats_without_a_loop_asleep_on_a_lock_never_kill(loop: ThreadSample) -> None:
    looks = silent(1000, LONG_MS, Look(0, loop=loop, quiet=True), thread=True)
    assert red(judged(WELL + looks)) is None


def test_an_interpreter_just_given_back_never_kills() -> None:
    held = silent(1000, 2600, Look(0, state="R", loop=traces.LOCKED), thread=True)
    between = Look(3670, loop_age_ms=2670, thread_age_ms=1, loop=traces.LOCKED)
    assert red(judged(WELL + held + [between, Look(3770)])) is None


def test_a_core_that_is_not_scheduled_never_kills() -> None:
    looks = silent(1000, LONG_MS, Look(0, state="R", loop=traces.UNSCHEDULED), thread=True)
    assert red(judged(WELL + looks)) is None


def test_a_loop_that_computes_for_a_while_never_kills() -> None:
    looks = [Look(at, at - 1000, loop=traces.running(at), state="R") for at in range(1070, 2400, 100)]
    assert red(judged(WELL + looks)) is None


def test_a_busy_core_that_makes_progress_is_green() -> None:
    looks = [
        Look(at, state="R", loop=traces.running(at), submitted=at + 40, completed=at, notes=queued(at))
        for at in range(0, LONG_MS, 100)
    ]
    assert set(judged(looks)) == {GREEN}


def test_a_loop_that_sleeps_between_its_beats_is_no_worry() -> None:
    assert set(judged([Look(at, loop_age_ms=90, loop=traces.EPOLL) for at in range(0, 5000, 100)])) == {GREEN}


def test_a_slow_store_is_never_no_progress() -> None:
    looks = [
        Look(at, submitted=3, in_store_ms=100, notes=queued(0, 0), writer=traces.NAPPING)
        for at in range(0, LONG_MS, 100)
    ]
    assert red(judged(looks)) is None


@pytest.mark.parametrize("stage", [SlotStage.DECIDING, SlotStage.WRITING, SlotStage.COMMITTED])
def test_a_command_that_was_taken_up_is_never_no_progress(stage: SlotStage) -> None:
    notes = (*queued(0, stage=stage), *queued(0, 0))
    assert red(judged([Look(at, submitted=3, notes=notes) for at in range(0, LONG_MS, 100)])) is None


def test_a_slow_read_is_never_no_progress() -> None:
    deciding = queued(0, stage=SlotStage.DECIDING, kind="read")
    behind = queued(0, 0, kind="read.verify")
    looks = [Look(at, submitted=3, notes=(*deciding, *behind)) for at in range(0, LONG_MS, 100)]
    assert set(judged(looks)) == {GREEN}


def test_a_silence_of_the_beats_is_never_called_no_progress() -> None:
    looks = silent(1000, 3000, Look(0, submitted=2, notes=queued(0), loop=traces.running(1)), thread=True)
    verdict = red(judged(WELL + looks))
    assert verdict is None


# What is our own doing.


def test_our_own_stall_is_not_held_against_the_core() -> None:
    late = Look(6000, 5000, 5000, state="T", loop=traces.STOPPED)
    assert judged([*WELL, late])[-1] is GREEN


def test_after_our_own_stall_silence_counts_from_its_end() -> None:
    looks = [Look(at, at - 1000, at - 1000, state="T", loop=traces.STOPPED) for at in range(6000, 6400, 100)]
    assert red(judged(WELL + looks)) is None
    looks += [Look(at, at - 1000, at - 1000, state="T", loop=traces.STOPPED) for at in (6400, 6500)]
    assert red(judged(WELL + looks)) is not None


@pytest.mark.parametrize("every_ms", [210, 250, 1000])
def test_a_guard_whose_looks_all_come_late_still_finds_a_hang_after_as_many_looks(every_ms: int) -> None:
    blocked = Look(0, loop=traces.LOCKED)
    looks = WELL + silent(1000, LONG_MS, blocked, every_ms=every_ms)
    verdicts = judged(looks)
    named = red(verdicts)
    assert named is not None
    assert (named.diagnosis, named.grade) == (Diagnosis.LOOP_BLOCKED, Grade.CERTAIN)
    found = [verdict.colour for verdict in verdicts].index(Colour.RED) - len(WELL)
    assert found >= PATIENCE.conclusive_ms // PATIENCE.interval_ms


def test_a_hang_is_found_though_one_look_in_four_comes_late() -> None:
    at_ms = [1000 + 550 * round_ + step for round_ in range(8) for step in (100, 200, 300, 550)]
    looks = [Look(at, at - 1000, loop=traces.LOCKED) for at in at_ms]
    verdict = red(judged(WELL + looks))
    assert verdict is not None
    assert verdict.diagnosis is Diagnosis.LOOP_BLOCKED


def test_a_look_that_comes_late_concludes_nothing() -> None:
    blocked = [Look(at, at - 1000, loop=traces.LOCKED) for at in (1070, 1170, 1270, 1370, 9370)]
    assert red(judged(WELL + blocked)) is None


PAUSED_MS = 10_000


@pytest.mark.parametrize("read_at_once", [True, False], ids=["commands read", "commands not read"])
def test_a_machine_that_was_paused_ends_no_command_that_is_being_decided(*, read_at_once: bool) -> None:
    notes = deciding_since(950, limit_ms=5000)
    after_ms = [1000 + PAUSED_MS + 10 + 100 * n for n in range(20)]
    busy = [
        Look(at, submitted=9, completed=n, notes=notes, deciding=traces.running(at - PAUSED_MS))
        for n, at in enumerate(after_ms)
    ]
    if not read_at_once:
        busy[0] = replace(busy[0], notes=None, deciding=None)
    verdicts = judged([*WELL, Look(1000), *busy])
    assert {verdict.colour for verdict in verdicts} == {Colour.GREEN}


@pytest.mark.parametrize("late_ms", [0, 400])
def test_that_the_machine_slept_is_told_however_late_we_wake(late_ms: int) -> None:
    looks = [*WELL, *(Look(at + late_ms, slept_ms=60_000) for at in (1000, 1100, 1200))]
    told = [verdict.diagnosis for verdict in judged(looks)]
    assert told.count(Diagnosis.SLEPT) == 1
    assert judged(looks)[-1] is GREEN


def test_our_late_ticks_are_counted() -> None:
    bench = Bench(PATIENCE)
    for at_ms in (0, 100, 500, 600, 1200):
        bench.judge(Look(at_ms).sampled())
    assert bench.late_ticks == 2


# What is worth saying.


def test_one_kind_of_evidence_alone_is_yellow() -> None:
    verdicts = judged(WELL + silent(1000, 900, Look(0, state="R", loop=None), thread=True))
    assert verdicts[-1].colour is Colour.YELLOW
    assert verdicts[-1].diagnosis is None
    assert [t.witness for t in verdicts[-1].testimonies] == ["beats"]


def test_a_core_that_has_never_beaten_is_not_judged() -> None:
    tick = Look(0).sampled()
    assert tick.beats is not None
    silent_tick: Sampled = replace(tick, beats=replace(tick.beats, loop_ns=0, thread_ns=0))
    assert Bench(PATIENCE).judge(silent_tick) is GREEN


@pytest.mark.parametrize("patience_ms", [400, 800])
def test_the_patience_of_the_policy_is_kept(patience_ms: int) -> None:
    patience = replace(PATIENCE, conclusive_ms=patience_ms)
    looks = WELL + silent(1000, 2000, Look(0, loop=traces.NAPPING))
    verdicts = judged(looks, patience)
    first = looks[[v.colour for v in verdicts].index(Colour.RED)]
    assert patience_ms < first.loop_age_ms <= patience_ms + 200
