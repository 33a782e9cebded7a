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
    (Phase.STOPPED, Trigger.HOPELESS): (
        "a guard has to begin after another that the policy had shut down, with nothing left of it; "
        "tests/unit/recovery/test_ways_back.py drives it by hand"
    ),
    (Phase.PROBATION, Trigger.SHUTDOWN): (
        "nobody has to have come while a core is on probation; tests/unit/recovery drives it by hand"
    ),
}
#: Worlds in which rows are reached: of all faults first, then of few, where rare things meet; and of each the seeds
#: that reach what no other does. A search over thousands takes minutes; these take a second.
PICKED: tuple[tuple[tuple[str, ...], tuple[int, ...]], ...] = (
    ((), (8, 21, 24, 57, 70)),
    (
        ("spawn is slow", "operator stops", "operator changes his mind", "boot is slow", "load"),
        (0, 3, 16, 25, 43, 65),
    ),
    (
        ("unkillable", "operator changes his mind", "operator stops", "spawn is slow", "leftover hangs"),
        (14, 15, 129, 133),
    ),
    (
        (
            "disk full at the fence",
            "disk fills",
            "disk read-only at the fence",
            "operator resumes",
            "frozen",
        ),
        (109,),
    ),
    (("crash loop", "operator stops", "configuration bad", "operator resumes", "operator restarts"), (84,)),
    (("page unreadable for long", "operator restarts", "operator restarts hard"), (0, 54, 55)),
    (("ticks always late", "disk flickers", "ledger locked", "disk fills"), (14, 17)),
    (("promoted unseen", "gateway says too much, unseen", "spare dies in the drain"), (73, 148, 196)),
    (("operator stops in a switch", "dies in a switch", "operator restarts hard"), (8, 180)),
    (
        ("drain refused", "drain never answered", "promotion refused", "promotion hangs before its fence"),
        (175,),
    ),
    (
        ("stuck with the store's lock", "unkillable", "operator restarts hard", "operator switches"),
        (45,),
    ),
    (("writer asleep", "guard dies", "lying core"), (17,)),
    (("crash loop", "operator restarts hard", "boot crashes"), (1003,)),
    (
        (
            "mode changes",
            "boot exits",
            "silent at the end of probation",
            "frozen",
            "memory grows",
        ),
        (1052,),
    ),
)
#: When the world has changed, the picked seeds may miss a row: then so many of each world are searched.
SEARCHED = 300


@cache
def _reached() -> frozenset[tuple[Phase, Trigger]]:
    wanted = {(before, trigger) for before, rows in TABLE.items() for trigger in rows} - set(UNREACHED)
    reached: set[tuple[Phase, Trigger]] = set()
    for faults, seeds in PICKED:
        for seed in seeds:
            reached |= run(seed, write_script(seed, faults)).rows
    for faults, _ in PICKED:
        if wanted <= reached:
            break
        for seed in range(SEARCHED):
            reached |= run(seed, write_script(seed, faults)).rows
    return frozenset(reached)


@pytest.mark.timeout(240)
def test_a_row_that_is_never_reached_says_why() -> None:
    listed = {(before, trigger) for before, rows in TABLE.items() for trigger in rows}
    assert listed - _reached() <= set(UNREACHED)


def test_only_rows_of_the_table_have_excuses() -> None:
    assert all(trigger in TABLE[phase] for phase, trigger in UNREACHED)
