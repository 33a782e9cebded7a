"""The quiet at the end of every run: what the guard can't heal heals by itself, the rest is the guard's.

No fault strikes any more, clients ask now and then, and whatever is still wrong must be found, told and
mended by the guard alone. Only a core that the kernel never lets go may stay as it is.
"""

from functools import partial

from hardcore.model.observations import Verb
from hardcore.model.phases import Wanted
from hardcore.recovery.policy import Word
from tests.simulation import store_faults
from tests.simulation.clock import NS_PER_S
from tests.simulation.conditions import (
    BLOCKED_LOCK,
    BLOCKED_POLL,
    BLOCKED_TIMER,
    FROZEN,
    WELL,
    Condition,
    Judged,
)
from tests.simulation.machine import RSS_BYTES, Life
from tests.simulation.mandate_faults import take_live
from tests.simulation.spare_faults import operator_asks
from tests.simulation.world import World

STUCK_FOR_EVER = 0.1
#: How often somebody who wanted reads only wants them no more.
WANTED_NO_MORE = 0.6
#: The kernel itself shows that these go on.
UNMISTAKABLE = frozenset({FROZEN, BLOCKED_TIMER, BLOCKED_LOCK, BLOCKED_POLL})
#: A lock that somebody holds for very long.
HELD_MS = 60_000
ASKED_AT_S = (0, 0, 60, 900)


def calm_down(world: World) -> None:
    """Begin the quiet."""
    world.quiet = True
    world.switches.clear()
    if world.held_into_the_quiet:
        store_faults.later(world, 1, HELD_MS, partial(store_faults.lets_go, world))
    else:
        store_faults.befall(world)  # somebody makes room; what is damaged stays damaged
    for life in [life for life in world.lives if life.alive]:
        _heal(world, life)
    if world.policy.mode != "act":
        take_live(world, "act")
    if world.disk_wanted is Wanted.SAFE and world.rng.random() < WANTED_NO_MORE:
        operator_asks(world, Verb.SAFE_OFF)
    for number, wait_s in enumerate(ASKED_AT_S):
        world.clock.after(wait_s * NS_PER_S, partial(_ask_for_service, world, number))


def _heal(world: World, life: Life) -> None:
    if life.in_kernel:
        if world.rng.random() < STUCK_FOR_EVER:
            world.stuck_for_ever = True
        else:
            life.let_go()
    life.extra_notes, life.extra_waiting, life.rss_bytes = (), 0, RSS_BYTES
    life.part_stalled_ns = 0
    life.claimed_seq = min(life.claimed_seq, life.witness.seq if life.witness else 0)
    idle = life.safe and life.condition.loop_works  # nothing is asked of a writer that may not write
    if idle or _nobody_else_heals(world, life.condition):
        life.befall(WELL)


def _nobody_else_heals(world: World, condition: Condition) -> bool:
    """Whether the guard may not call this a hang, or the policy does nothing about it.

    A guard that is always late, or without a page, is excused from all hangs but those that the kernel shows.
    """
    if condition.judged is Judged.NEVER or (world.guard.always_worried and condition not in UNMISTAKABLE):
        return True
    return not all(world.policy.asks(diagnosis, Word.REBOOT_PROCESS) for diagnosis in condition.right)


def _ask_for_service(world: World, number: int) -> None:
    world.gateway.submit(f"quiet-{number}")
    if number == 0:
        world.worry()
