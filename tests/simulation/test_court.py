"""What a poison costs, in worlds with nothing else in them."""

import pytest

from tests.simulation.run import Script, run

SEEDS = 60
ONCE = (
    "poison crashes",
    "poison exits",
    "poison blocks",
    "poison crashes in the write",
    "poison crashes later",
    "ten poisons at once",
)
KILLS = 150
#: A policy under which a service is killed as often as anybody likes.
UNBOUNDED = 5


@pytest.mark.parametrize("name", ONCE)
def test_a_poison_costs_one_death_and_so_do_ten_of_them(name: str) -> None:
    for seed in range(SEEDS):
        result = run(seed, Script("crisis", 0, ((500 + 37 * seed, name),), warm=True))
        assert result.broken is None, result
        # Nobody is suspect of an end that nobody could read.
        assert result.faults.total() <= result.deaths <= result.faults.total() + result.unseen, f"seed {seed}"


def test_each_of_ten_poisons_is_convicted_once() -> None:
    for seed in range(SEEDS):
        result = run(seed, Script("crisis", 0, ((500, "ten poisons at once"),), warm=True))
        assert set(result.convicted.values()) <= {1}
        assert len(result.convicted) + 2 * result.unseen >= 10 * result.faults.total()


def test_a_copy_that_takes_minutes_costs_no_verdict() -> None:
    convicted = 0
    for seed in range(SEEDS):
        result = run(seed, Script("crisis", 0, ((500, "copy for the court is slow"),), warm=True))
        assert result.broken is None, result
        convicted += result.convicted.total()
        assert result.letters == result.convicted.total(), f"seed {seed}: somebody was left to a person"
    assert convicted > SEEDS // 3


def test_a_full_batch_that_dies_of_nothing_that_a_trial_shows_costs_no_request() -> None:
    for seed in range(SEEDS):
        result = run(seed, Script("crisis", 1, ((500, "a full batch dies"),), warm=True))
        assert (result.broken, result.letters) == (None, 0), result


def test_a_hundred_and_fifty_kills_from_outside_convict_nobody() -> None:
    kills = seed = 0
    while kills < KILLS:
        faults = tuple((300 + 350 * n, "SIGKILL") for n in range(40))
        result = run(seed, Script("crisis", UNBOUNDED, faults, warm=True))
        assert result.broken is None, result
        assert (result.letters, result.convicted.total()) == (0, 0)
        kills, seed = kills + result.faults.total(), seed + 1


def test_an_event_that_kills_whoever_starts_from_it_costs_two_starts() -> None:
    for seed in range(SEEDS):
        faults = ((500, "poison in the log"), (3000, "SIGKILL"))
        result = run(seed, Script("crisis", 3, faults, warm=False))
        assert result.broken is None, result
        assert result.deaths == 0
