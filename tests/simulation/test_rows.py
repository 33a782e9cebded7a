"""Every row of the table is taken in some world, or says why it can't be."""

from functools import cache

import pytest

from hardcore.model.phases import Phase
from hardcore.recovery.transitions import TABLE, Trigger
from tests.simulation.run import run, write_script

#: Rows that no seed reaches, each with its reason.
UNREACHED = {
    (Phase.SNAPSHOT_LIVE, Trigger.SPAWN_FAILED): (
        "a birth has to outlast the whole time of a start and to fail in the milliseconds before somebody says "
        "that there is no evidence of a core that was never there; tests/unit/recovery drives it by hand"
    ),
}
#: Worlds of all faults first, then of few, where rare things meet.
WHERE_IT_IS_REACHED = (
    (),
    ("spawn is slow", "operator stops", "operator changes his mind", "boot is slow", "load"),
    ("unkillable", "operator changes his mind", "operator stops", "spawn is slow", "leftover hangs"),
    ("disk full at the fence", "disk fills", "disk read-only at the fence", "operator resumes", "frozen"),
    ("crash loop", "operator stops", "configuration bad", "operator resumes", "operator restarts"),
    ("page unreadable for long", "operator restarts", "operator restarts hard"),
    ("ticks always late", "disk flickers", "ledger locked", "disk fills"),
    ("promoted unseen", "gateway says too much, unseen", "spare dies in the drain"),
    ("operator stops in a switch", "dies in a switch", "operator restarts hard"),
    ("drain refused", "drain never answered", "promotion refused", "promotion hangs before its fence"),
    ("stuck with the store's lock", "unkillable", "operator restarts hard", "operator switches"),
)
#: Seeds are run in blocks, now of these worlds, now of those; more than so many rounds mean that a row is dead.
BLOCK = 100
ROUNDS_MAX = 20


@cache
def _reached() -> frozenset[tuple[Phase, Trigger]]:
    wanted = {(before, trigger) for before, rows in TABLE.items() for trigger in rows} - set(UNREACHED)
    reached: set[tuple[Phase, Trigger]] = set()
    for number in range(ROUNDS_MAX):
        for faults in WHERE_IT_IS_REACHED:
            for seed in range(number * BLOCK, (number + 1) * BLOCK):
                reached |= run(seed, write_script(seed, faults)).rows
            if wanted <= reached:
                return frozenset(reached)
    return frozenset(reached)


@pytest.mark.timeout(240)
def test_a_row_that_is_never_reached_says_why() -> None:
    listed = {(before, trigger) for before, rows in TABLE.items() for trigger in rows}
    assert listed - _reached() <= set(UNREACHED)


def test_only_rows_of_the_table_have_excuses() -> None:
    assert all(trigger in TABLE[phase] for phase, trigger in UNREACHED)
