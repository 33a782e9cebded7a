"""Everything that goes wrong, by name: each fault is one small function of a world.

A fault acts on whatever is there at its moment; the phase it hit is noted, so that a run can say which
pairs of fault and phase were really tried. The operator is a fault like any other.
"""

from collections.abc import Callable, Mapping
from functools import partial

from hardcore.model import observations as seen
from hardcore.model.recorder import CommandNote, SlotStage
from tests.simulation import conditions
from tests.simulation.clock import NS_PER_MS, NS_PER_S
from tests.simulation.conditions import Condition
from tests.simulation.machine import BootPlan, Stage
from tests.simulation.mandate_faults import MANDATE
from tests.simulation.poison import POISON
from tests.simulation.senses_faults import SENSES_CRISIS, SENSES_LOAD
from tests.simulation.spare_faults import SPARE_CRISIS, SPARE_LOAD, operator_asks
from tests.simulation.store import Disk, Rot
from tests.simulation.store_faults import (
    at_the_fence,
    disk,
    disk_flickers,
    end_the_present_one,
    later,
    locked,
    locked_at_the_fence,
    rots,
    safe_orders,
)
from tests.simulation.switches import Looking, Order, Taking
from tests.simulation.world import World

Fault = Callable[[World], None]

MS = NS_PER_MS


def _ends(code: int | None = None, signal: int | None = None, words: str = "") -> Fault:
    def fault(world: World) -> None:
        if (core := world.core) is not None:
            if signal is not None:
                core.signal(signal)
            else:
                core.die(seen.Exit(code=code), words)

    return fault


def _befalls(condition: Condition, low_ms: int = 0, high_ms: int = 0) -> Fault:
    """A condition that lasts; without bounds it never ends by itself."""

    def fault(world: World) -> None:
        world.befall(condition, world.rng.randrange(low_ms, high_ms) * MS if high_ms else None)

    return fault


def _boots(
    at: Stage, *, code: int | None = None, signal: int | None = None, words: str = "", times: int = 1
) -> Fault:
    """The next boots end in a bad way: at the fence (BORN) or at the proof (FENCED)."""

    def fault(world: World) -> None:
        end = seen.Exit(code=code, signal=signal)
        for _ in range(world.rng.randrange(1, times + 1)):
            plan = BootPlan(world.rng.randrange(5, 150) * MS, world.rng.randrange(5, 60) * MS, at, end, words)
            world.switches.boot_plans.append(plan)
        end_the_present_one(world)

    return fault


def _boot_hangs(at: Stage) -> Fault:
    def fault(world: World) -> None:
        world.switches.boot_plans.append(BootPlan(50 * MS, 20 * MS, at, hangs=True))
        end_the_present_one(world)

    return fault


def _boot_is_slow(world: World) -> None:
    slow_ns = world.rng.randrange(1, 2 * world.policy.startup_timeout_ms) * MS
    world.switches.boot_plans.append(
        BootPlan(slow_ns, 20 * MS, extends_ns=world.rng.randrange(1, 30) * NS_PER_S)
    )
    end_the_present_one(world)


def _epoch_is_not_told(world: World) -> None:
    world.switches.boot_plans.append(BootPlan(50 * MS, 20 * MS, tells_epoch=False))
    end_the_present_one(world)


def _spawns_fail(world: World) -> None:
    world.switches.failing_spawns += world.rng.randrange(1, 4)
    end_the_present_one(world)


def _spawn_is_slow(world: World) -> None:
    """Making the process takes long, and in the meantime the operator often says something."""
    world.switches.slow_spawns_ns.append(world.rng.randrange(200, 3000) * MS)
    world.switches.failing_spawns += world.rng.randrange(2)
    end_the_present_one(world)
    if world.rng.random() < 0.6:
        verb = world.rng.choice([seen.Verb.STOP, seen.Verb.RESTART_HARD])
        world.clock.after(world.rng.randrange(20, 400) * MS, lambda: operator_asks(world, verb))


def _changes_his_mind(world: World) -> None:
    """The operator says several things in a row, often while something else goes on."""
    if world.rng.random() < 0.5:
        world.befall(world.rng.choice([conditions.FROZEN, conditions.BLOCKED_POLL]))
    for _ in range(world.rng.randrange(2, 5)):
        verb = world.rng.choice(list(seen.Verb))
        world.clock.after(world.rng.randrange(1, 700) * MS, partial(operator_asks, world, verb))


def _freezes_in_boot(world: World) -> None:
    end_the_present_one(world)
    wait_ns = world.rng.randrange(300) * MS
    for_ns = world.rng.choice([None, 3 * NS_PER_S])

    def freeze() -> None:
        if (core := world.core) is not None:
            core.befall(conditions.FROZEN, for_ns)
            world.worry()  # with a spare the boot is over by then

    world.clock.after(wait_ns, freeze)


def _gil_is_held(holding: Condition, low_ms: int, high_ms: int) -> Fault:
    """A long call into C; then the thread's beat comes a moment before the loop's."""

    def fault(world: World) -> None:
        core = world.core
        if core is None or core.condition is not conditions.WELL:
            return
        world.worry()
        core.befall(holding)

        def returned() -> None:
            if core.condition is holding:
                core.befall(conditions.GIL_RETURNED, world.rng.randrange(1, 40) * MS)

        later(world, low_ms, high_ms, returned)

    return fault


def _slow_reads(world: World) -> None:
    """Long reads fill their pool and others wait behind them: nothing is completed, nothing is wrong."""
    core = world.core
    if core is None or core.stage is not Stage.READY:
        return
    now_ns = world.clock.now_ns
    stages = (SlotStage.DECIDING, SlotStage.DECIDING, SlotStage.QUEUED)
    core.extra_notes = tuple(
        CommandNote(stage, f"r{n}", "", "read.verify", "", (), now_ns, stage_ns=now_ns)
        for n, stage in enumerate(stages)
    )
    core.extra_waiting = len(stages)
    world.worry()

    def over() -> None:
        core.extra_notes, core.extra_waiting = (), 0

    world.clock.after(world.rng.randrange(500, 6000) * MS, over)


def _writer(condition: Condition) -> Fault:
    """The writer stops taking up commands, and some come."""

    def fault(world: World) -> None:
        world.befall(condition)
        for n in range(2):
            key = f"behind-the-writer-{world.clock.now_ns}-{n}"
            world.clock.after((120 + 50 * n) * MS, partial(world.gateway.submit, key))

    return fault


def _deadlocked(world: World) -> None:
    """Two locks in two orders. Where nobody sees the stacks it is a command that takes too long."""
    seen_ = world.switches.looking is Looking.WORKS
    world.befall(conditions.DEADLOCKED if seen_ else conditions.DEADLOCKED_UNSEEN)


def _answers_falsely(condition: Condition) -> Fault:
    """The core goes on as if all was well, and some ask it."""

    def fault(world: World) -> None:
        world.befall(condition)
        for n in range(3):
            key = f"believed-{world.clock.now_ns}-{n}"
            world.clock.after((120 + 90 * n) * MS, partial(world.gateway.submit, key))

    return fault


def _out_of_memory(world: World) -> None:
    if (core := world.core) is not None:
        core.rss_bytes += world.rng.randrange(1 << 30)
        core.oom_kills = 1
        core.signal(9)


def _suspends(world: World) -> None:
    """The machine is suspended: two clocks go on and the one that counts stands still."""
    world.slept_ns += world.rng.choice([1, 60, 28_800]) * NS_PER_S
    world.worry()


def _wall_jumps(world: World) -> None:
    world.wall_shift_ns += world.rng.choice([-3600, -1, 1, 3600]) * NS_PER_S
    world.worry()


def _load(world: World) -> None:
    """The machine is busy: our ticks come late, and the core is not always scheduled."""
    world.switches.tick_late_ns = world.rng.randrange(50, 600) * MS
    world.befall(conditions.STARVED, world.rng.randrange(50, 3000) * MS)
    world.clock.after(5 * NS_PER_S, lambda: setattr(world.switches, "tick_late_ns", 0))


def _guard_stalls(world: World) -> None:
    """The guard gets no processor time."""
    world.guard.awake_ns = world.clock.now_ns + world.rng.randrange(100, 8000) * MS


def _guard_dies(world: World) -> None:
    world.kill_guard()


def _guard_dies_at_an_order(world: World) -> None:
    world.switches.orders_until_death = world.rng.randrange(6)


def _unkillable(world: World) -> None:
    """The core hangs in the kernel, where no signal reaches it, for a while."""
    core = world.core
    if core is None:
        return
    core.in_kernel = True
    if world.rng.random() < 0.7:
        core.befall(conditions.FROZEN)
        world.worry()
    else:
        operator_asks(world, seen.Verb.RESTART_HARD)
    if world.rng.random() < 0.7:
        world.clock.after(world.rng.randrange(100, 9000) * MS, core.let_go)


def _ignores_term(world: World) -> None:
    if (core := world.core) is not None:
        core.ignores_term = True
        operator_asks(world, world.rng.choice([seen.Verb.RESTART, seen.Verb.STOP]))


def _stranger_terms(world: World) -> None:
    if (core := world.core) is not None:
        core.terminate(by_guard=False)


def _stranger_fences(world: World) -> None:
    """A core that somebody started by hand raises the epoch behind our back."""
    world.store.epoch += 1
    world.stranger_raised = True
    world.gateway.submit(f"behind-the-fence-{world.clock.now_ns}")


def _evidence(taking: Taking) -> Fault:
    def fault(world: World) -> None:
        world.switches.evidence.append(taking)
        world.befall(world.rng.choice([conditions.FROZEN, conditions.BLOCKED_LOCK]))

    return fault


def _page_is_lost(world: World) -> None:
    if (core := world.core) is not None:
        core.page_lost = True
        core.signal(11)


def _drill(world: World) -> None:
    """The core is told to break itself."""
    number = world.guard.life.number if world.guard.life is not None else 0
    world.to_guard(seen.DrillStarted(world.clock.now_ns, "crash", number))
    if world.rng.random() < 0.9:
        world.clock.after(2 * MS, lambda: _ends(signal=6)(world))


def _asks(verb: seen.Verb) -> Fault:
    return lambda world: operator_asks(world, verb)


def _crash_loop(world: World) -> None:
    _boots(Stage.BORN, signal=11, times=9)(world)


#: What must never cost a core its life: the faults of a load-only world.
LOAD: Mapping[str, Fault] = {
    "stopped for a moment": _befalls(conditions.FROZEN, 20, 250),
    "blocked for a moment": _befalls(conditions.BLOCKED_TIMER, 20, 250),
    "waiting for a moment": _befalls(conditions.BLOCKED_POLL, 20, 1200),
    "disk wait": _befalls(conditions.BLOCKED_DISK, 100, 6000),
    "computing for a moment": _befalls(conditions.SPINNING, 100, 1200),
    "busy with progress": _befalls(conditions.BUSY, 100, 6000),
    "GIL held for a moment": _gil_is_held(conditions.GIL_HELD, 100, 1200),
    "GIL held by the loop for a moment": _gil_is_held(conditions.GIL_HELD_BY_LOOP, 100, 1200),
    "GIL held asleep for a moment": _befalls(conditions.GIL_ASLEEP, 20, 250),
    "long collection": _gil_is_held(conditions.COLLECTING, 100, 4500),
    "loop over for a moment": _befalls(conditions.LOOP_OVER, 20, 250),
    "transaction with progress": _befalls(conditions.LONG_TRANSACTION, 1000, 20_000),
    "transaction of some seconds": _befalls(conditions.SLOW_TRANSACTION, 100, 4500),
    "silent to questions for a moment": _befalls(conditions.DEAF, 100, 1200),
    "machine is suspended": _suspends,
    "wall clock jumps": _wall_jumps,
    "starved": _befalls(conditions.STARVED, 100, 6000),
    "store slow": _befalls(conditions.STORE_SLOW, 100, 6000),
    "disk slow": _befalls(conditions.DISK_SLOW, 100, 6000),
    "slow reads": _slow_reads,
    "load": _load,
    "guard stalls": _guard_stalls,
    **SENSES_LOAD,
    **SPARE_LOAD,
}

CRISIS: Mapping[str, Fault] = {
    **MANDATE,
    "SIGSEGV": _ends(signal=11),
    "SIGABRT": _ends(signal=6),
    "SIGBUS": _ends(signal=7),
    "SIGKILL": _ends(signal=9),
    "exit 0": _ends(code=0),
    "exit 1": _ends(code=1),
    "COMMIT failed": _ends(code=74, words="COMMIT_FAILED"),
    "frozen": _befalls(conditions.FROZEN),
    "frozen, thawed": _befalls(conditions.FROZEN, 250, 900),
    "blocked in a timer": _befalls(conditions.BLOCKED_TIMER),
    "blocked on a lock": _befalls(conditions.BLOCKED_LOCK),
    "blocked in a wait": _befalls(conditions.BLOCKED_POLL),
    "loop over": _befalls(conditions.LOOP_OVER),
    "spinning": _befalls(conditions.SPINNING),
    "GIL held": _befalls(conditions.GIL_HELD),
    "GIL held by the loop": _befalls(conditions.GIL_HELD_BY_LOOP),
    "GIL held asleep": _befalls(conditions.GIL_ASLEEP),
    "collection without end": _befalls(conditions.COLLECTING),
    "deadlock": _deadlocked,
    "slow transaction": _befalls(conditions.SLOW_TRANSACTION),
    "lying core": _answers_falsely(conditions.LYING),
    "deaf core": _befalls(conditions.DEAF),
    "ledger locked": locked,
    "ledger locked at the fence": locked_at_the_fence,
    "disk fills": disk(Disk.FULL, 100, 20_000),
    "disk read-only": disk(Disk.READ_ONLY, 100, 20_000),
    "disk stalls": disk(Disk.STALLED, 100, 20_000),
    "disk flickers": disk_flickers,
    "disk full at the fence": at_the_fence(Disk.FULL),
    "disk read-only at the fence": at_the_fence(Disk.READ_ONLY),
    "disk stalls at the fence": at_the_fence(Disk.STALLED),
    "ledger damaged deep inside": rots(Rot.DEEP),
    "ledger damaged at its head": rots(Rot.HEAD),
    "out of memory": _out_of_memory,
    "order to read only lost": safe_orders(Order.LOST),
    "order to read only refused": safe_orders(Order.REFUSED),
    "order to read only late": safe_orders(Order.LATE),
    "writer asleep": _writer(conditions.WRITER_ASLEEP),
    "writer gone": _writer(conditions.WRITER_GONE),
    "boot crashes": _boots(Stage.BORN, signal=11, times=2),
    "boot exits": _boots(Stage.BORN, code=1, times=2),
    "boot crashes after its fence": _boots(Stage.FENCED, signal=6, times=3),
    "crash loop": _crash_loop,
    "proof fails": _boots(Stage.FENCED, code=65, words="STORE_CORRUPT"),
    "store locked": _boots(Stage.BORN, code=69, words="DB_LOCKED"),
    "no room at one fence": _boots(Stage.BORN, code=73, words="DISK_FULL"),
    "configuration bad": _boots(Stage.BORN, code=78, words="CONFIG_INVALID"),
    "boot hangs before its fence": _boot_hangs(Stage.BORN),
    "boot hangs after its fence": _boot_hangs(Stage.FENCED),
    "boot freezes": _freezes_in_boot,
    "boot is slow": _boot_is_slow,
    "epoch is not told": _epoch_is_not_told,
    "spawns fail": _spawns_fail,
    "spawn is slow": _spawn_is_slow,
    "evidence late": _evidence(Taking.LATE),
    "evidence never": _evidence(Taking.NEVER),
    "dies during evidence": _evidence(Taking.DIES),
    "page lost": _page_is_lost,
    "unkillable": _unkillable,
    "ignores TERM": _ignores_term,
    "TERM by a stranger": _stranger_terms,
    "fenced by a stranger": _stranger_fences,
    "guard dies": _guard_dies,
    "guard dies at an order": _guard_dies_at_an_order,
    "drill": _drill,
    "operator stops": _asks(seen.Verb.STOP),
    "operator restarts": _asks(seen.Verb.RESTART),
    "operator restarts hard": _asks(seen.Verb.RESTART_HARD),
    "operator resumes": _asks(seen.Verb.RESUME),
    "operator changes his mind": _changes_his_mind,
    **SENSES_CRISIS,
    **SPARE_CRISIS,
    **POISON,
}

FAULTS: Mapping[str, Fault] = {**LOAD, **CRISIS}
