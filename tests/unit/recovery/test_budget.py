from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hardcore.recovery.budget import NS_PER_MS, NS_PER_S, Budget, backoff_ns

#: A busy machine makes an example slow; that says nothing about the rule.
UNTIMED = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])

WINDOW_NS = 60 * NS_PER_S


def _after(*deaths_ns: int, limit: int = 5) -> Budget:
    budget = Budget(limit, WINDOW_NS)
    for at_ns in deaths_ns:
        budget = budget.after_death(at_ns)
    return budget


def test_as_many_deaths_as_allowed_do_not_spend_it() -> None:
    assert not _after(1, 2, 3, 4, 5).spent(5)


def test_one_death_more_spends_it() -> None:
    assert _after(1, 2, 3, 4, 5, 6).spent(6)


def test_five_deaths_before_the_edge_of_a_window_and_five_after_are_ten() -> None:
    edge = WINDOW_NS
    assert _after(*range(edge - 5, edge), edge, edge + 1).spent(edge + 1)


def test_a_death_leaves_the_window_exactly_at_its_end() -> None:
    budget = _after(0, 1, 2, 3, 4, 5)
    assert budget.spent(WINDOW_NS - 1)
    assert not budget.spent(WINDOW_NS)


def test_a_stamp_from_the_future_counts_as_fresh_and_ages_from_now() -> None:
    budget = Budget(1, WINDOW_NS, (10**18,)).at(1000)
    assert budget.deaths_ns == (1000,)
    assert budget.at(1000 + WINDOW_NS).deaths_ns == ()


def test_what_has_left_the_window_is_not_kept() -> None:
    assert _after(0, WINDOW_NS).deaths_ns == (WINDOW_NS,)


@UNTIMED
@given(st.lists(st.integers(0, 10**12), max_size=30), st.integers(1, 6))
def test_no_window_holds_more_deaths_than_allowed_before_it_is_spent(times: list[int], limit: int) -> None:
    budget = Budget(limit, WINDOW_NS)
    for at_ns in sorted(times):
        budget = budget.after_death(at_ns)
        recent = [t for t in times if at_ns - WINDOW_NS < t <= at_ns and t in budget.deaths_ns]
        assert budget.spent(at_ns) == (len(budget.deaths_ns) > limit)
        assert set(recent) == set(budget.deaths_ns)


def test_the_pause_doubles_up_to_its_bound() -> None:
    pauses = [backoff_ns(tries, 500, 30_000, 0.0) // NS_PER_MS for tries in range(1, 9)]
    assert pauses == [500, 1000, 2000, 4000, 8000, 16_000, 30_000, 30_000]


def test_jitter_takes_away_a_quarter_at_most() -> None:
    assert backoff_ns(1, 400, 30_000, 1.0) == 300 * NS_PER_MS
    assert backoff_ns(1, 400, 30_000, 0.0) == 400 * NS_PER_MS


def test_no_number_of_tries_is_too_large() -> None:
    assert backoff_ns(10**6, 1, 30_000, 0.0) == 30_000 * NS_PER_MS
