"""What befalls a switch: the spare, the order to drain, the code on the disk, the core that was left behind.

None of it may cost a commit, and what befalls the spare alone may cost nobody anything.
"""

from collections.abc import Callable, Mapping
from functools import partial

from msgspec.structs import replace

from hardcore.model import observations as seen
from hardcore.model.looks import LockHolder
from hardcore.model.phases import Wanted
from hardcore.model.recorder import Witness
from hardcore.model.verdicts import Diagnosis
from tests.simulation import conditions
from tests.simulation.clock import NS_PER_MS
from tests.simulation.machine import BootPlan, Life, Stage
from tests.simulation.store_faults import befall, later
from tests.simulation.switches import Draining
from tests.simulation.world import FREE_BYTES, World

MS = NS_PER_MS
Fault = Callable[[World], None]

_SILENT = (conditions.FROZEN, conditions.BLOCKED_LOCK, conditions.SPINNING, conditions.GIL_HELD)


def _to_spare(deed: Callable[[World, Life], None]) -> Fault:
    """Something befalls the spare, if there is one."""

    def fault(world: World) -> None:
        if (spare := world.spare) is not None:
            deed(world, spare)
            world.worry()

    return fault


def _spare_dies(world: World, spare: Life) -> None:
    spare.signal(world.rng.choice([9, 11]))


def _spare_falls_silent(world: World, spare: Life) -> None:
    for_ns = world.rng.choice([None, None, 300 * MS, 3000 * MS])
    spare.befall(world.rng.choice(_SILENT), for_ns)


def _then_the_core(befalls: Fault, most_ms: int) -> Fault:
    """First the spare, and then the core that it waits for."""

    def fault(world: World) -> None:
        befalls(world)
        later(world, 1, most_ms, lambda: core.signal(9) if (core := world.core) is not None else None)

    return fault


def _spares(at: Stage | None = None, *, hangs: bool = False, refuses: bool = False, times: int = 1) -> Fault:
    """The next spares go wrong: as they warm up (WARM), at their fence (BORN), at their proof (FENCED)."""

    def fault(world: World) -> None:
        end = None if hangs else seen.Exit(code=world.rng.choice([1, 70]))
        for _ in range(world.rng.randrange(1, times + 1)):
            warm_ns = world.rng.randrange(20, 400) * MS
            plan = BootPlan(warm_ns, 20 * MS, at, end, hangs=hangs, refuses=refuses)
            world.switches.spare_plans.append(plan)
        if (spare := world.spare) is not None:
            spare.signal(9)  # the next one shows it
            world.worry()
        later(world, 3000, 5000, partial(_switch, world))

    return fault


def _switch(world: World) -> None:
    """A reason to need the spare: the core dies, or a person wants another."""
    if world.quiet:
        return
    if world.rng.random() < 0.6:
        if (core := world.core) is not None:
            core.signal(9)
    else:
        ask_for_switch(world)


def _spare_is_slow(world: World) -> None:
    world.switches.spare_plans.append(BootPlan(world.rng.randrange(1000, 30_000) * MS, 20 * MS))
    if (spare := world.spare) is not None:
        spare.signal(9)
        world.worry()


def ask_for_switch(world: World) -> None:
    """The operator wants another core, and the code on the disk was looked at."""
    world.to_guard(_restart(world))
    world.worry()


def _restart(world: World) -> seen.OperatorAsked:
    """The core is asked for its own code too; it may not answer."""
    core = world.core
    says = core is not None and core.condition.loop_works
    serves = core.build if core is not None and says else ""
    return seen.OperatorAsked(world.clock.now_ns, seen.Verb.RESTART, build=world.build, serves=serves)


def _wanted(before: Wanted, verb: seen.Verb) -> Wanted:
    """What stands on the disk once this was asked for."""
    match verb:
        case seen.Verb.STOP:
            return Wanted.DOWN
        case seen.Verb.SAFE_ON if before is not Wanted.DOWN:
            return Wanted.SAFE
        case seen.Verb.SAFE_OFF if before is Wanted.SAFE:
            return Wanted.UP
        case _:
            return before


def operator_asks(world: World, verb: seen.Verb) -> None:
    """The operator speaks; what he wants is on disk before anybody hears it."""
    if not world.guard.works and verb is not seen.Verb.STOP:
        return
    world.disk_wanted = _wanted(world.disk_wanted, verb)
    image = verb is not seen.Verb.STOP and world.rng.random() < 0.3
    asked = _restart(world) if verb is seen.Verb.RESTART else seen.OperatorAsked(world.clock.now_ns, verb)
    part = "importer" if verb is seen.Verb.RESTART_COMPONENT else ""
    world.guard.tell(replace(asked, reason="because", image=image, component=part))


def _drains(how: Draining, most: int = 1) -> Fault:
    def fault(world: World) -> None:
        for _ in range(world.rng.randrange(1, most + 1)):
            world.switches.drains.append(how)
        ask_for_switch(world)

    return fault


def _drains_in_vain(world: World) -> None:
    """A command holds up the drain, for a while or until its time is over."""
    for_ns = world.rng.choice([None, 500 * MS, 2500 * MS])
    world.befall(conditions.SLOW_TRANSACTION, for_ns)
    for n in range(3):
        later(world, 100, 200, partial(world.gateway.submit, f"in-the-drain-{world.clock.now_ns}-{n}"))
    later(world, 200, 400, partial(ask_for_switch, world))


def _updates(*, bad: bool = False) -> Fault:
    """Other code lies on the disk; then the operator asks for it."""

    def fault(world: World) -> None:
        world.build = f"b{len(world.lives) + 1}{'-bad' if bad else ''}"
        if bad:
            world.bad_builds.add(world.build)
        ask_for_switch(world)
        if bad:
            later(world, 4000, 30_000, partial(world.bad_builds.clear))

    return fault


def _memory_is_small(world: World) -> None:
    world.free_bytes = 300 << 20
    later(world, 500, 20_000, lambda: setattr(world, "free_bytes", FREE_BYTES))
    if world.rng.random() < 0.5 and (spare := world.spare) is not None:
        spare.signal(9)


def _stuck_in_the_store(world: World) -> None:
    """The core hangs in the kernel with the store's lock in its hand: no spare gets past its fence."""
    core = world.core
    if core is None or core.stage is not Stage.READY or world.store.ill:
        return
    core.in_kernel = True
    core.befall(conditions.FROZEN)
    befall(world, holder=LockHolder(1000 + core.serial, "core"))

    def lets_go() -> None:
        if world.store.holder is not None and world.store.holder.pid == 1000 + core.serial:
            befall(world, world.store.disk)
        core.let_go()

    if world.rng.random() < 0.8:
        later(world, 100, 20_000, lets_go)


def _told_too_much(world: World) -> None:
    """A fault of the gateway's own: it says that it passed on what was never committed."""
    serving = world.gateway.serving
    if serving is None or serving.unfenced or serving.epoch != world.store.epoch:
        return
    if not world.warm or world.quiet or world.store.ill:
        return
    seq, epoch = len(world.store.commits) + world.rng.randrange(1, 4), world.store.epoch
    world.is_true(Diagnosis.STORE_CORRUPT)
    wait_ns = world.rng.randrange(400) * MS
    if (core := world.core) is not None:
        core.signal(9)
    world.clock.after(
        wait_ns, lambda: world.to_guard(seen.GatewayWitnessed(world.clock.now_ns, Witness(seq, epoch, "?")))
    )


def _two_in_a_row(world: World) -> None:
    """A core dies, and its successor dies in the middle of taking over."""
    if (core := world.core) is not None:
        core.signal(9)
    later(world, 1, 500, lambda: other.signal(9) if (other := world.core) is not None else None)


def _guard_dies_in_a_switch(world: World) -> None:
    ask_for_switch(world)
    if world.rng.random() < 0.5:
        world.switches.orders_until_death = world.rng.randrange(6)
    else:
        later(world, 1, 120, world.kill_guard)


def _guard_dies_in_a_takeover(world: World) -> None:
    if (core := world.core) is not None:
        core.signal(world.rng.choice([9, 11]))
    if world.rng.random() < 0.5:
        world.switches.orders_until_death = world.rng.randrange(5)
    else:
        later(world, 1, 100, world.kill_guard)


def _stops_in_a_switch(world: World) -> None:
    ask_for_switch(world)
    verb = world.rng.choice([seen.Verb.STOP, seen.Verb.RESTART_HARD])
    later(world, 1, 150, partial(operator_asks, world, verb))


def _dies_in_a_switch(world: World) -> None:
    """Whoever lives of the two, the one that was drained or the one that takes over, dies in the middle."""
    ask_for_switch(world)

    def strikes() -> None:
        living = [life for life in world.lives if life.alive]
        if living:
            world.rng.choice(living).signal(9)

    later(world, 1, 300, strikes)


def _promoted_unseen(world: World) -> None:
    """The next spare takes over and its word of the epoch is lost."""
    plan = BootPlan(world.rng.randrange(20, 400) * MS, 20 * MS, tells_epoch=False)
    world.switches.spare_plans.append(plan)
    if (spare := world.spare) is not None:
        spare.signal(9)
        world.worry()
    later(world, 3000, 5000, partial(_switch, world))


def _told_too_much_unseen(world: World) -> None:
    """The same while the core that takes over does not say its epoch."""
    world.switches.boot_plans.append(BootPlan(50 * MS, 20 * MS, tells_epoch=False))
    _promoted_unseen(world)
    later(world, 2900, 5100, partial(_told_too_much, world))


def _spare_dies_in_the_drain(world: World) -> None:
    ask_for_switch(world)
    later(world, 1, 12, lambda: spare.signal(9) if (spare := world.spare) is not None else None)


SPARE_LOAD: Mapping[str, Fault] = {
    "spare dies": _to_spare(_spare_dies),
    "spare falls silent": _to_spare(_spare_falls_silent),
    "spare is slow": _spare_is_slow,
    "memory is small": _memory_is_small,
}

SPARE_CRISIS: Mapping[str, Fault] = {
    "spare dies, then the core": _then_the_core(_to_spare(_spare_dies), 100),
    "spare silent, then the core": _then_the_core(_to_spare(_spare_falls_silent), 2500),
    "spares fail to warm up": _spares(Stage.WARM, times=4),
    "spares hang warming up": _spares(Stage.WARM, hangs=True, times=2),
    "promotion refused": _spares(refuses=True, times=2),
    "promotion fails at its fence": _spares(Stage.BORN, times=2),
    "promotion fails at its proof": _spares(Stage.FENCED, times=2),
    "promotion hangs before its fence": _spares(Stage.BORN, hangs=True),
    "promotion hangs after its fence": _spares(Stage.FENCED, hangs=True),
    "operator switches": ask_for_switch,
    "operator updates": _updates(),
    "operator updates badly": _updates(bad=True),
    "drain refused": _drains(Draining.REFUSED, 4),
    "drain never answered": _drains(Draining.NEVER),
    "dies of the drain": _drains(Draining.DIES),
    "drain held up": _drains_in_vain,
    "promoted unseen": _promoted_unseen,
    "spare dies in the drain": _spare_dies_in_the_drain,
    "gateway says too much, unseen": _told_too_much_unseen,
    "stuck with the store's lock": _stuck_in_the_store,
    "gateway says too much": _told_too_much,
    "two deaths in a row": _two_in_a_row,
    "guard dies in a switch": _guard_dies_in_a_switch,
    "guard dies in a takeover": _guard_dies_in_a_takeover,
    "operator stops in a switch": _stops_in_a_switch,
    "dies in a switch": _dies_in_a_switch,
}
