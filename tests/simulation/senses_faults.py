"""What befalls the guard's senses and the whole machine: pauses, pages nobody can read, a kernel that says nothing.

In all of these a core may be well, and then it must go on; or it may hang behind them, and then somebody must find
it all the same. What nobody can see is told, and is never taken for health or for a death.
"""

from collections.abc import Callable, Mapping
from functools import partial

from hardcore.model.phases import Phase
from hardcore.model.recorder import CommandNote, SlotStage
from tests.simulation import conditions
from tests.simulation.clock import NS_PER_MS
from tests.simulation.looks import Spoiling, Spoilt
from tests.simulation.machine import Life, Stage
from tests.simulation.store_faults import later
from tests.simulation.world import World

MS = NS_PER_MS
Fault = Callable[[World], None]

#: What a core has that answers nobody, seen from the outside: without its page these are hard to tell apart.
_SILENT = (
    conditions.FROZEN,
    conditions.BLOCKED_TIMER,
    conditions.BLOCKED_LOCK,
    conditions.BLOCKED_POLL,
    conditions.LOOP_OVER,
    conditions.DEAF,
)


def _page_is_spoilt(how: Spoiling, high_ms: int) -> Fault:
    """For a while the page is not what it should be."""

    def fault(world: World) -> None:
        for_ns = world.rng.randrange(50, high_ms) * MS
        world.spoilt = Spoilt(world.clock.now_ns + for_ns, how)
        world.worry()

    return fault


def _page_is_scribbled_on(world: World) -> None:
    """Somebody has written over the head of the page: it is no evidence any more, for this life."""
    if (core := world.core) is not None:
        core.page_lost = True
        world.worry()


def _kernel_says_nothing(world: World) -> None:
    for_ns = world.rng.randrange(100, 5_000) * MS
    world.switches.unseen_until_ns = world.clock.now_ns + for_ns
    world.worry()


def _then_silent(unseen: Fault) -> Fault:
    """Something can't be seen, and in that time the core falls silent."""

    def fault(world: World) -> None:
        unseen(world)
        later(world, 1, 3000, partial(world.befall, world.rng.choice(_SILENT)))

    return fault


def _ticks_always_late(world: World) -> None:
    """A small and busy machine: to the end of the world some of our ticks come late."""
    world.switches.late_every = world.rng.randrange(1, 6)
    world.switches.late_by_ns = world.rng.choice([110, 150, 250, 600]) * MS
    world.worry()


def _own_writes_slow(world: World) -> None:
    """The disk is slow and answers: each small write takes long and comes back, for a while."""
    world.switches.own_write_ns = world.rng.choice([250, 800, 1400, 1450]) * MS
    world.befall(conditions.DISK_SLOW, world.rng.randrange(300, 5000) * MS)
    later(world, 2000, 6000, lambda: setattr(world.switches, "own_write_ns", MS))


def _pause(world: World, gap_ns: int) -> None:
    """Nobody on the machine can do anything for so long, and the clock goes on."""
    world.clock.leap(gap_ns)
    for life in world.lives:
        life.pause(gap_ns)


def _machine_sleeps(world: World) -> None:
    """The whole machine sleeps: nobody can do anything, the clock goes on."""
    _pause(world, world.rng.choice([300, 1500, 30_000, 3_600_000]) * MS)
    core = world.core
    if core is not None and core.condition is conditions.WELL:
        core.befall(conditions.STARVED, world.rng.randrange(150) * MS)
        world.worry()


def _machine_paused(world: World) -> None:
    """The whole machine is stopped in the middle of commands; some go on for a while after it, others come."""
    core = world.core
    if core is None or core.stage is not Stage.READY or core.extra_notes:
        return
    world.worry()
    now_ns = world.clock.now_ns
    core.extra_notes = (
        CommandNote(SlotStage.DECIDING, "paused", "", "read.verify", "", (), now_ns, stage_ns=now_ns),
    )
    core.extra_waiting = 1
    if world.rng.random() < 0.3:  # it ends by its own time, which is not the clock's
        later(world, 1, 100, partial(world.befall, conditions.SLOW_TRANSACTION))
    for n in range(world.rng.randrange(2, 6)):
        later(world, 1, 60, partial(world.gateway.submit, f"before-the-pause-{now_ns}-{n}"))
    later(world, 5, 70, partial(_pause_amid, world, core))


def _pause_amid(world: World, core: Life) -> None:
    _pause(world, world.rng.choice([700, 6000, 11_000, 60_000]) * MS)
    for n in range(world.rng.randrange(4)):
        later(world, 1, 900, partial(world.gateway.submit, f"after-the-pause-{world.clock.now_ns}-{n}"))
    for most_ms in (2500, 4000):  # once more for what had not begun by then
        later(world, most_ms - 2499, most_ms, partial(_answered_at_last, core))


def _answered_at_last(core: Life) -> None:
    core.extra_notes, core.extra_waiting = (), 0
    if core.condition is conditions.SLOW_TRANSACTION:
        core.befall(conditions.WELL)


def _leftover_hangs(world: World) -> None:
    """A core hangs in the kernel, its guard dies, and the next one can't end it for long."""
    core = world.core
    if core is None:
        return
    core.in_kernel = True
    world.kill_guard()
    if world.rng.random() < 0.8:
        later(world, 100, 40_000, core.let_go)


def _at_the_end_of_probation(world: World, tries: int = 400) -> None:
    """A core falls silent shortly before it would have proven itself."""
    if world.quiet or tries == 0:
        return
    if world.guard.phase is not Phase.PROBATION:
        world.clock.after(10 * MS, partial(_at_the_end_of_probation, world, tries - 1))
        return
    wait_ms = max(1, world.policy.probation_ms - world.rng.randrange(50, 1900))
    silent = world.rng.choice([conditions.BLOCKED_POLL, conditions.SPINNING, conditions.GIL_HELD])
    for_ns = world.rng.choice([None, 900 * MS, 2500 * MS])
    world.clock.after(wait_ms * MS, partial(world.befall, silent, for_ns))


def _silent_at_the_end_of_probation(world: World) -> None:
    if (core := world.core) is not None:
        core.signal(9)
    _at_the_end_of_probation(world)


#: What must never cost a core its life.
SENSES_LOAD: Mapping[str, Fault] = {
    "page torn": _page_is_spoilt(Spoiling.TORN, 900),
    "page late": _page_is_spoilt(Spoiling.LATE, 900),
    "page nonsense": _page_is_spoilt(Spoiling.NONSENSE, 3000),
    "page unreadable for long": _page_is_spoilt(Spoiling.TORN, 5_000),
    "page scribbled on": _page_is_scribbled_on,
    "kernel says nothing": _kernel_says_nothing,
    "ticks always late": _ticks_always_late,
    "own writes slow": _own_writes_slow,
    "machine sleeps": _machine_sleeps,
    "machine paused amid commands": _machine_paused,
}

SENSES_CRISIS: Mapping[str, Fault] = {
    "page scribbled on, then silent": _then_silent(_page_is_scribbled_on),
    "kernel says nothing, then silent": _then_silent(_kernel_says_nothing),
    "leftover hangs": _leftover_hangs,
    "silent at the end of probation": _silent_at_the_end_of_probation,
}
