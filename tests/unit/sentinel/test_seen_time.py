"""The time that we were there to see."""

from hardcore.sentinel.seen_time import GAPS_MAX, SeenTime
from tests.unit.sentinel.traces import MS


def _looked(*looks: tuple[int, bool]) -> SeenTime:
    seen = SeenTime(100 * MS)
    for at_ms, late in looks:
        seen.look(at_ms * MS, late=late)
    return seen


def test_time_between_looks_that_came_in_time_counts_in_full() -> None:
    seen = _looked((1000, False), (1100, False), (1290, False))
    assert (seen.since(1000 * MS), seen.gap_ns) == (290 * MS, 190 * MS)


def test_of_the_time_before_a_late_look_one_interval_counts() -> None:
    seen = _looked((1000, False), (1100, False), (9100, True))
    assert (seen.since(1000 * MS), seen.gap_ns) == (200 * MS, 100 * MS)
    assert seen.since(5000 * MS) == 100 * MS
    assert seen.since(9050 * MS) == 50 * MS


def test_what_was_seen_before_a_late_look_still_counts() -> None:
    seen = _looked((1000, False), (1300, True), (1400, False), (1700, True), (1800, False))
    assert seen.since(1000 * MS) == 400 * MS
    assert seen.between(1300 * MS, 1800 * MS) == 300 * MS


def test_nothing_before_the_first_look_counts() -> None:
    assert _looked((1000, False), (1100, False)).since(0) == 100 * MS


def test_after_the_machine_was_away_nothing_counts_that_was_before() -> None:
    seen = _looked((1000, False), (1300, True), (1400, False))
    seen.forgive()
    assert seen.begins_anew
    seen.look(1500 * MS, late=False)
    assert (seen.since(1000 * MS), seen.begins_anew) == (100 * MS, False)


def test_what_is_yet_to_come_has_not_been_seen() -> None:
    assert _looked((1000, False)).since(2000 * MS) == 0


def test_a_guard_that_is_always_late_remembers_a_bounded_number_of_gaps_and_counts_no_more_for_it() -> None:
    late = ((1000 + 300 * n, True) for n in range(1, 3 * GAPS_MAX))
    seen = _looked((1000, False), *late)
    assert seen.since(0) == (GAPS_MAX + 1) * 100 * MS
