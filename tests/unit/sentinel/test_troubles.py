"""What the judge makes of store, disk and machine: troubles that end nobody, and what is only told."""

from typing import Any

import pytest
from msgspec.structs import replace

from hardcore.model.looks import DiskFacts, LockHolder
from hardcore.model.observations import StoreFault, StoreLooked, StoreTold, Surveyed
from hardcore.model.recorder import SlotStage
from hardcore.model.verdicts import Colour, Diagnosis, Grade
from tests.unit.sentinel import traces
from tests.unit.sentinel.traces import (
    MS,
    Look,
    Told,
    at_ns_of,
    computing,
    deciding,
    heard,
    judged,
    named,
    queued,
    red,
    silent,
    well,
)

LONG_MS = 20_000
WELL = well(1000)

# DB_LOCKED


def _in_store(until_ms: int, **more: Any) -> list[Look]:
    notes = queued(100, stage=SlotStage.WRITING)
    like = Look(0, submitted=1, in_store_ms=100, notes=notes)
    return [replace(like, at_ms=at, **more) for at in range(100, until_ms, 100)]


def _locked(until_ms: int, *pids: int, ours: bool = False) -> list[StoreLooked]:
    return [
        StoreLooked(at_ns_of(at), 1, (LockHolder(pids[n % len(pids)], "sqlite3", ours),))
        for n, at in enumerate(range(500, until_ms, 500))
    ]


def test_a_stranger_with_the_stores_lock_is_named() -> None:
    verdict = red(heard(_in_store(4000), _locked(4000, 77)))
    assert verdict is not None
    assert (verdict.diagnosis, verdict.grade) == (Diagnosis.DB_LOCKED, Grade.CERTAIN)
    assert any("process 77 (sqlite3)" in testimony.why for testimony in verdict.testimonies)


def test_the_core_may_hold_its_own_stores_lock() -> None:
    assert named(heard(_in_store(LONG_MS), _locked(LONG_MS, 77, ours=True))) is None


def test_strangers_that_pass_through_are_no_lock() -> None:
    assert named(heard(_in_store(LONG_MS), _locked(LONG_MS, 77, 78))) is None


def test_a_lock_that_nobody_waits_for_is_only_told() -> None:
    verdicts = heard(well(LONG_MS), _locked(LONG_MS, 77))
    assert named(verdicts) is None
    assert verdicts[-1].colour is Colour.YELLOW


def test_one_look_at_a_lock_is_none() -> None:
    assert named(heard(_in_store(5000), _locked(600, 77))) is None


def test_a_locked_store_is_not_the_commands_fault() -> None:
    looks = deciding(LONG_MS, in_store_ms=0)
    assert named(heard(looks, _locked(LONG_MS, 77))) is None


# The disk


def _surveys(until_ms: int, disk: DiskFacts) -> list[Surveyed]:
    return [Surveyed(at_ns_of(at), 1, disk) for at in range(500, until_ms, 1000)]


ROOM = 1 << 30


def test_a_core_that_says_so_and_a_disk_without_room_are_certain() -> None:
    told: list[Told] = [
        StoreTold(at_ns_of(1200), 1, StoreFault.FULL),
        *_surveys(1000, DiskFacts(0, False, 5, 0, "ENOSPC")),
    ]
    assert named(heard(well(3000), told)) == (Diagnosis.DISK_FULL, Grade.LIKELY)
    told += _surveys(2000, DiskFacts(0, False, 5, 0, "ENOSPC"))
    verdict = heard(well(3000), told)[-1]
    assert (verdict.diagnosis, verdict.grade) == (Diagnosis.DISK_FULL, Grade.CERTAIN)


@pytest.mark.parametrize(
    ("disk", "diagnosis"),
    [
        (DiskFacts(1 << 20, read_only=False, write_ns=5), Diagnosis.DISK_FULL),
        (DiskFacts(ROOM, read_only=False, write_ns=None, fault="EDQUOT"), Diagnosis.DISK_FULL),
        (DiskFacts(ROOM, read_only=True, write_ns=None), Diagnosis.DISK_READ_ONLY),
        (DiskFacts(ROOM, read_only=False, write_ns=None, fault="EROFS"), Diagnosis.DISK_READ_ONLY),
        (DiskFacts(ROOM, read_only=False, write_ns=None, fault="EIO"), Diagnosis.DISK_READ_ONLY),
    ],
)
def test_what_two_surveys_find_is_enough(disk: DiskFacts, diagnosis: Diagnosis) -> None:
    verdict = red(heard(well(3000), _surveys(3000, disk)))
    assert verdict is not None
    assert verdict.diagnosis is diagnosis


def test_what_one_survey_finds_is_not() -> None:
    assert named(heard(well(1400), _surveys(1400, DiskFacts(0, read_only=False, write_ns=5)))) is None


def test_a_word_of_the_core_is_taken_back_by_the_core() -> None:
    told = [StoreTold(at_ns_of(500), 1, StoreFault.FULL), StoreTold(at_ns_of(1500), 1, StoreFault.OK)]
    verdicts = heard(well(3000), told)
    assert red(verdicts) is not None
    assert verdicts[-1].colour is Colour.GREEN


SLOW = DiskFacts(ROOM, read_only=False, write_ns=None, pending_ns=2500 * MS)


def test_a_core_that_waits_in_the_store_on_a_disk_that_stands_still_is_not_the_cause() -> None:
    assert named(heard(_in_store(5000), _surveys(5000, SLOW))) == (Diagnosis.DISK_STALLED, Grade.CERTAIN)


def test_a_writer_in_the_hands_of_the_disk_is_no_hang() -> None:
    looks = [
        Look(at, submitted=2, notes=queued(0), state="D", writer=traces.ON_DISK) for at in range(0, 6000, 100)
    ]
    assert named(heard(looks, _surveys(6000, SLOW))) == (Diagnosis.DISK_STALLED, Grade.CERTAIN)


def test_a_slow_disk_that_nobody_waits_for_is_only_told() -> None:
    verdicts = heard(well(5000), _surveys(5000, SLOW))
    assert named(verdicts) is None
    assert verdicts[-1].colour is Colour.YELLOW


def test_a_slow_disk_is_no_excuse_for_a_loop_that_computes() -> None:
    looks = [replace(look, in_store_ms=900) for look in computing(4000)]
    verdict = red(heard(WELL + looks, _surveys(5000, SLOW)))
    assert verdict is not None
    assert verdict.diagnosis is Diagnosis.SPINNING


def test_a_full_disk_hides_no_hang() -> None:
    full = DiskFacts(0, read_only=False, write_ns=5)
    looks = WELL + silent(1000, 900, Look(0, loop=traces.NAPPING))
    verdicts = heard(looks, _surveys(2000, full))
    assert Diagnosis.LOOP_BLOCKED in {verdict.diagnosis for verdict in verdicts}


# What is told and never acted on


def test_a_core_that_is_not_scheduled_is_starved() -> None:
    looks = [
        Look(at, at - 1000, at - 1000, loop=traces.unlet(at), state="R") for at in range(1070, 3000, 100)
    ]
    verdicts = judged(WELL + looks)
    assert verdicts[-1].colour is Colour.YELLOW
    assert verdicts[-1].diagnosis is Diagnosis.STARVED


def test_a_guard_that_is_late_again_and_again_is_starved_itself() -> None:
    verdicts = judged([Look(at) for at in range(0, 3000, 250)])
    assert {verdict.diagnosis for verdict in verdicts[4:]} == {Diagnosis.STARVED}
    assert {verdict.colour for verdict in verdicts[4:]} == {Colour.YELLOW}


def test_a_machine_that_slept_gives_fresh_deadlines_and_is_told_once() -> None:
    blocked = silent(1000, 600, Look(0, loop=traces.NAPPING))
    looks = [replace(look, slept_ms=60_000 if look.at_ms > 1200 else 0) for look in blocked]
    verdicts = judged(WELL + looks)
    assert [verdict.diagnosis for verdict in verdicts].count(Diagnosis.SLEPT) == 1
    assert named(verdicts) is None
    assert named(judged(WELL + blocked)) is not None


@pytest.mark.parametrize("hour_ms", [3_600_000, -3_600_000])
def test_a_wall_clock_that_is_set_changes_nothing(hour_ms: int) -> None:
    looks = [replace(look, set_by_ms=hour_ms if look.at_ms > 500 else 0) for look in well(2000)]
    assert {verdict.colour for verdict in judged(looks)} == {Colour.GREEN}
