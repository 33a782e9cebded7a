"""A short campaign: a few seeds of `make campaign`, on one living house."""

import random

from tests.campaign.block import carry_out
from tests.campaign.faults import FAULTS
from tests.campaign.run import plan

SEEDS = (3, 11)


def test_every_law_holds_over_faults_that_a_seed_has_chosen() -> None:
    told = carry_out(SEEDS)
    assert [(one.seed, one.broken) for one in told] == [(seed, ()) for seed in SEEDS]
    assert any(one.met for one in told), "nobody was struck: the campaign tests nothing"


def test_each_fault_is_chosen_by_some_seed_and_a_seed_always_chooses_alike() -> None:
    chosen = {strike.fault.name for seed in range(500) for strike in plan(random.Random(seed))}
    assert chosen == {fault.name for fault in FAULTS}
    assert plan(random.Random(7)) == plan(random.Random(7))
