"""Every row of the table is taken in some world, or says why it can't be."""

from functools import cache

import pytest

from hardcore.model.phases import Phase
from hardcore.recovery.transitions import TABLE, Trigger
from tests.simulation.run import run

#: Rows that no seed reaches, each with its reason.
UNREACHED = {
    (Phase.SNAPSHOT_LIVE, Trigger.SPAWN_FAILED): (
        "a birth has to outlast the whole time of a start and to fail in the milliseconds before somebody says "
        "that there is no evidence of a core that was never there; tests/unit/recovery drives it by hand"
    ),
}
#: Seeds are run in blocks until every row is reached; more than so many mean that a row is dead.
SEEDS_MAX = 20_000
BLOCK = 500


@cache
def _reached() -> frozenset[tuple[Phase, Trigger]]:
    wanted = {(before, trigger) for before, rows in TABLE.items() for trigger in rows} - set(UNREACHED)
    reached: set[tuple[Phase, Trigger]] = set()
    for first in range(0, SEEDS_MAX, BLOCK):
        for seed in range(first, first + BLOCK):
            reached |= run(seed).rows
        if wanted <= reached:
            break
    return frozenset(reached)


@pytest.mark.timeout(240)
def test_a_row_that_is_never_reached_says_why() -> None:
    listed = {(before, trigger) for before, rows in TABLE.items() for trigger in rows}
    assert listed - _reached() <= set(UNREACHED)


@pytest.mark.timeout(240)
def test_only_rows_of_the_table_have_excuses() -> None:
    assert all(trigger in TABLE[phase] for phase, trigger in UNREACHED)
