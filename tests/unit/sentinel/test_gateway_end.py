"""Which ends of a gateway make what it was reading suspect."""

import signal

import pytest

from hardcore.model.observations import Exit
from hardcore.model.verdicts import Diagnosis
from hardcore.sentinel.gateway_end import GREW_BYTES, may_be_of_reading


def of_reading(
    how: Exit,
    judged: Diagnosis | None = None,
    *,
    drill: bool = False,
    oom_kills: int | None = 0,
    grown_bytes: int = 0,
) -> bool:
    return may_be_of_reading(how, judged, drill=drill, oom_kills=oom_kills, grown_bytes=grown_bytes)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_nothing_is_suspect_of_a_gateway_that_was_ended_from_outside(number: int) -> None:
    assert not of_reading(Exit(signal=number))


@pytest.mark.parametrize(
    "number", [signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGILL, signal.SIGFPE]
)
def test_a_crash_may_be_of_what_was_read(number: int) -> None:
    assert of_reading(Exit(signal=number))


def test_nothing_is_suspect_of_a_drill_however_it_ends() -> None:
    assert not of_reading(Exit(signal=signal.SIGSEGV), drill=True)


def test_an_end_by_an_error_counts_and_an_orderly_or_an_unread_one_does_not() -> None:
    assert of_reading(Exit(code=1))
    assert not of_reading(Exit(code=0))
    assert not of_reading(Exit())


@pytest.mark.parametrize(
    ("judged", "counts"),
    [
        (Diagnosis.FROZEN, False),
        (Diagnosis.LOOP_BLOCKED, False),
        (Diagnosis.DEADLOCK, False),
        (Diagnosis.GIL_HELD, True),
        (Diagnosis.SPINNING, True),
    ],
)
def test_of_one_that_we_ended_only_a_loop_that_computed_counts(judged: Diagnosis, counts: bool) -> None:
    assert of_reading(Exit(signal=signal.SIGKILL), judged) is counts


def test_memory_counts_only_where_the_kernel_killed_for_it_and_this_process_took_it() -> None:
    killed = Exit(signal=signal.SIGKILL)
    assert of_reading(killed, oom_kills=1, grown_bytes=GREW_BYTES)
    assert not of_reading(killed, oom_kills=1, grown_bytes=GREW_BYTES - 1)
    assert not of_reading(killed, oom_kills=0, grown_bytes=GREW_BYTES)
    assert not of_reading(killed, oom_kills=None, grown_bytes=GREW_BYTES)
