import pytest

from hardcore.model.clocks import Clocks
from hardcore.model.verdicts import Colour
from hardcore.sentinel.witnesses import clocks as witness
from hardcore.sentinel.witnesses.clocks import ClockFacts, ClockWatch
from tests.unit.sentinel.traces import MS


def _looked(*looks: tuple[int, int, int] | None) -> ClockFacts:
    """The last of these looks: monotonic, how far the boot clock is ahead of it, and the wall of that (ms)."""
    watch, found = ClockWatch(), ClockFacts()
    for n, look in enumerate(looks):
        clocks = None
        at_ms = 100 * n
        if look is not None:
            at_ms, ahead_ms, wall_ms = look
            clocks = Clocks((at_ms + ahead_ms) * MS, (at_ms + ahead_ms + wall_ms) * MS)
        found = watch.look(clocks, at_ms * MS)
    return found


def test_a_boot_clock_that_ran_ahead_has_counted_a_sleep() -> None:
    assert _looked((0, 0, 7), (100, 60_000, 7)) == ClockFacts(slept_ns=60_000 * MS)


def test_a_wall_that_was_set_is_a_jump_and_no_sleep() -> None:
    for set_by in (3_600_000, -3_600_000):
        assert _looked((0, 0, 0), (100, 0, set_by)) == ClockFacts(jumped_ns=set_by * MS)


def test_the_time_between_two_readings_is_none_of_it() -> None:
    assert _looked((0, 0, 0), (100, 400, 900)) == ClockFacts()


def test_it_is_told_once() -> None:
    assert _looked((0, 0, 0), (100, 60_000, 0), (200, 60_000, 0)) == ClockFacts()


def test_nobody_read_the_clocks() -> None:
    assert _looked(None, None) == ClockFacts()
    assert _looked((0, 0, 0), None) == ClockFacts()


@pytest.mark.parametrize(
    ("facts", "colour"),
    [(ClockFacts(slept_ns=10**10), Colour.YELLOW), (ClockFacts(jumped_ns=-(10**10)), Colour.GREEN)],
)
def test_a_sleep_worries_and_a_set_wall_is_only_told(facts: ClockFacts, colour: Colour) -> None:
    told = witness.testify(facts)
    assert told is not None
    assert told.colour is colour
    assert witness.testify(ClockFacts()) is None
