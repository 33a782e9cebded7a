"""Patience with a slow client: used up by time, earned by bytes, and never more than there was to begin with."""

from hypothesis import given
from hypothesis import strategies as st

from hardcore.crisis.pace import NS_PER_MS, Pace, takes


def _ms(count: float) -> int:
    return int(count * NS_PER_MS)


def test_silence_uses_patience_up() -> None:
    pace = Pace(100, 1000)
    pace.begin(_ms(50))
    assert pace.left_ms(_ms(50)) == 100
    assert pace.left_ms(_ms(120)) == 30
    assert pace.left_ms(_ms(200)) == 0


def test_drops_that_come_slower_than_the_least_pace_only_put_the_end_off() -> None:
    pace = Pace(100, 1000)
    pace.begin(0)
    now_ms = 0
    while pace.left_ms(_ms(now_ms)):
        now_ms += 10
        pace.moved(5)  # 500 bytes a second
    assert now_ms == 190


def test_a_body_that_moves_fast_enough_never_ends() -> None:
    pace = Pace(100, 1000)
    pace.begin(0)
    for second in range(1, 1000):
        pace.moved(1000)
        assert pace.left_ms(_ms(second * 99)) > 0


def test_the_time_in_which_a_client_may_not_send_does_not_count() -> None:
    pace = Pace(100, 1000)
    pace.begin(0)
    assert pace.left_ms(_ms(40)) == 60
    pace.go_on(_ms(5_000))
    assert pace.left_ms(_ms(5_010)) == 50


@given(st.integers(1, 10**9), st.integers(0, 10**9))
def test_a_client_that_takes_nothing_never_takes_enough(before: int, more: int) -> None:
    assert not takes(before, before + more, 30_000, 1000)


def test_enough_is_the_least_pace_or_all_that_waits() -> None:
    assert takes(100_000, 70_000, 30_000, 1000)
    assert not takes(100_000, 70_001, 30_000, 1000)
    assert not takes(20_000, 1, 30_000, 1000)
    assert not takes(20_000, 0, 30_000, 1000)  # nothing waits: there is nothing to wait for either
