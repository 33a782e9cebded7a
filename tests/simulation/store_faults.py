"""What befalls the ledger's store: its disk, its lock, its bytes; and which of it has been true, and when.

The truth is noted whenever it changes and whenever somebody looks, so that the checkers can say of each word of the
guard whether it was so.
"""

from collections.abc import Callable
from functools import partial

from hardcore.model.looks import LockHolder
from tests.simulation.clock import NS_PER_MS
from tests.simulation.store import REFUSALS, Disk, Rot
from tests.simulation.switches import Order
from tests.simulation.world import World

MS = NS_PER_MS
Fault = Callable[[World], None]


def befall(
    world: World,
    disk: Disk = Disk.WELL,
    holder: LockHolder | None = None,
    rot: Rot | None = None,
) -> None:
    """Something befalls the ledger's store, or is over."""
    if rot is not None:
        world.store.rot = rot
    world.note_truths()
    world.store.befall(world.clock.now_ns, disk, holder)
    world.note_truths()
    world.worry()


def later(world: World, low_ms: int, high_ms: int, deed: Callable[[], object]) -> None:
    """Do something after a time that is left to chance."""
    world.clock.after(world.rng.randrange(low_ms, high_ms) * NS_PER_MS, deed)


def end_the_present_one(world: World) -> None:
    """A bad boot shows only when there is one."""
    if world.rng.random() < 0.8 and (core := world.core) is not None:
        core.signal(9)


def asked_meanwhile(world: World) -> None:
    """Clients ask while something is the matter with the store."""
    for n in range(3):
        key = f"at-the-store-{world.clock.now_ns}-{n}"
        later(world, 1, 900, partial(world.gateway.submit, key))


def disk(disk: Disk, low_ms: int, high_ms: int) -> Fault:
    """The ledger's disk takes no write for a while, or until somebody makes room at the end."""

    def fault(world: World) -> None:
        if world.store.ill:
            return
        befall(world, disk)
        asked_meanwhile(world)
        if high_ms and world.rng.random() < 0.7:
            later(world, low_ms, high_ms, partial(heals, world, disk))

    return fault


def heals(world: World, disk: Disk) -> None:
    if world.store.disk is disk:
        befall(world)


def disk_flickers(world: World) -> None:
    """There is room, there is none, there is: one trouble, not ten."""
    if world.store.ill:
        return
    disk = world.rng.choice(list(REFUSALS))
    at_ms = 0
    for n in range(world.rng.randrange(2, 6)):
        world.clock.after(at_ms * MS, partial(befall, world, disk if n % 2 == 0 else Disk.WELL))
        world.clock.after((at_ms + 20) * MS, partial(asked_meanwhile, world))
        at_ms += world.rng.randrange(50, 4000)
    world.clock.after(at_ms * MS, partial(befall, world))


def at_the_fence(disk: Disk) -> Fault:
    """A core begins while the disk takes no write."""

    def fault(world: World) -> None:
        if world.store.ill:
            return
        befall(world, disk)
        if (core := world.core) is not None:
            core.signal(9)
        if world.rng.random() < 0.7:
            later(world, 300, 30_000, partial(heals, world, disk))

    return fault


def locked(world: World) -> None:
    """Another program holds the ledger's lock, while clients ask or while a core begins."""
    if world.store.ill:
        return
    befall(world, Disk.WELL, LockHolder(4711, "backup"))
    asked_meanwhile(world)
    if world.rng.random() < 0.3:
        later(world, 10, 2000, partial(end_the_present_one, world))
    later(world, 200, 20_000, lambda: befall(world, world.store.disk))


def locked_at_the_fence(world: World) -> None:
    """A core begins while another program holds the ledger's lock; for seconds, or till long into the quiet."""
    if world.store.ill:
        return
    befall(world, Disk.WELL, LockHolder(4711, "backup"))
    world.held_into_the_quiet = world.rng.random() < 0.3
    if (core := world.core) is not None:
        core.signal(9)
    if not world.held_into_the_quiet:
        later(world, 200, world.rng.choice([1500, 8000, 90_000]), partial(lets_go, world))


def lets_go(world: World) -> None:
    """Whoever held the lock has ended."""
    world.held_into_the_quiet = False
    if world.store.holder is not None:
        befall(world, world.store.disk)


def rots(rot: Rot) -> Fault:
    """The ledger is damaged; the next core finds it, at its start or behind its serving."""

    def fault(world: World) -> None:
        if world.store.ill:
            return
        befall(world, rot=rot)
        if (core := world.core) is not None:
            core.signal(9)

    return fault


def safe_orders(order: Order) -> Fault:
    """An order to read only, or to write again, does not come through as it should."""

    def fault(world: World) -> None:
        for _ in range(world.rng.randrange(1, 4)):
            world.switches.safe_orders.append(order)
        disk(world.rng.choice(list(REFUSALS)), 300, 9000)(world)

    return fault
