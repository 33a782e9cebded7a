"""Poisonous commands, and what goes wrong with trials, by name."""

from collections.abc import Callable, Mapping

from msgspec.structs import replace

from hardcore.model.trials import RuleRemoved
from hardcore.quarantine_file import without_rule
from tests.simulation.clock import NS_PER_MS
from tests.simulation.harms import Harm
from tests.simulation.switches import Trying
from tests.simulation.world import World

Fault = Callable[[World], None]

#: More than are tried under a policy that tries few.
BATCH = 8


def _poison(harm: Harm, times: int = 1) -> Fault:
    def fault(world: World) -> None:
        for n in range(world.rng.randrange(1, 4)):
            world.gateway.submit(f"beside-{world.clock.now_ns}-{n}")
        for n in range(times):
            name = f"poison-{world.clock.now_ns}" + (f"-{n}" if n else "")
            world.gateway.submit(name, keyed=world.rng.random() < 0.8, harm=harm)

    return fault


def _trials(trying: Trying) -> Fault:
    """The next courts go so; and there is something to be tried."""

    def fault(world: World) -> None:
        world.switches.trials += [trying] * world.rng.randrange(1, 4)
        _poison(world.rng.choice([Harm.CRASH, Harm.EXIT, Harm.WRITE, Harm.LOG]))(world)

    return fault


def _guard_dies_in_court(world: World) -> None:
    """The guard dies while a suspect is on trial, between any two of its orders."""
    _poison(world.rng.choice([Harm.CRASH, Harm.WRITE]))(world)
    wait_ns = world.rng.randrange(10, 2500) * NS_PER_MS
    world.clock.after(wait_ns, world.kill_guard if world.rng.random() < 0.5 else lambda: _at_an_order(world))


def _at_an_order(world: World) -> None:
    if not world.quiet:
        world.switches.orders_until_death = world.rng.randrange(8)


def _killed_in_court(world: World) -> None:
    """The core is killed from outside while somebody is on trial."""
    _poison(Harm.CRASH)(world)
    _later(world, world.rng.randrange(50, 2500), lambda: _core_dies(world, 9))


def _letter_is_released(world: World) -> None:
    """A person takes a rule away, and what it named comes again."""
    if not world.aside.rules:
        return
    letter = world.letters[str(world.rng.choice(world.aside.rules)["id"])]
    world.aside = without_rule(world.aside, letter.id)
    if letter.seq is not None:
        world.store.parked.discard(letter.seq)
    world.to_guard(RuleRemoved(world.clock.now_ns, letter.id))
    again = next((x for x in world.gateway.requests if x.key_hash == letter.name and x.keyed), None)
    if again is not None:
        world.gateway.submit(again.key, harm=again.harm)


def _letter_is_released_a_day_later(world: World) -> None:
    """When a person takes a rule away, no guard remembers its trial any more; the next core starts from what it named."""
    _poison(Harm.LOG)(world)

    def a_day_later() -> None:
        if world.quiet or world.disk_court is None:
            return
        open_ = tuple(one for one in world.disk_court.suspects if one.open)
        world.kill_guard()
        world.disk_court = replace(world.disk_court, suspects=open_)
        _later(world, 1500, lambda: _letter_is_released(world))
        _later(world, 2000, lambda: _core_dies(world, 9))

    _later(world, 500, lambda: _core_dies(world, 9))  # its successor starts from the event
    _later(world, world.rng.randrange(2000, 6000), a_day_later)


def _batch_dies(world: World) -> None:
    """A core dies of nothing that a trial shows, with many at work in it."""
    for n in range(BATCH):
        world.gateway.submit(f"batch-{world.clock.now_ns}-{n}")
    _later(world, world.rng.randrange(4, 14), lambda: _core_dies(world, 11))


def _rule_waits_for_the_disk(world: World) -> None:
    """The disk takes a rule only after a while, and meanwhile the guard may die."""
    world.switches.rule_write_ns = world.rng.randrange(100, 4000) * NS_PER_MS
    _poison(world.rng.choice([Harm.CRASH, Harm.WRITE]))(world)
    if world.rng.random() < 0.7:
        _later(world, world.rng.randrange(500, 4000), world.kill_guard)


def _core_dies(world: World, signal: int) -> None:
    if (core := world.core) is not None and not world.quiet:
        core.signal(signal)


def _later(world: World, wait_ms: int, deed: Callable[[], None]) -> None:
    world.clock.after(wait_ms * NS_PER_MS, deed)


POISON: Mapping[str, Fault] = {
    "poison crashes": _poison(Harm.CRASH),
    "poison exits": _poison(Harm.EXIT),
    "poison blocks": _poison(Harm.BLOCK),
    "poison crashes in the write": _poison(Harm.WRITE),
    "poison crashes later": _poison(Harm.LATER),
    "poison in the log": _poison(Harm.LOG),
    "ten poisons at once": _poison(Harm.CRASH, times=10),
    "court hangs": _trials(Trying.HANGS),
    "court dies": _trials(Trying.DIES),
    "court tries nobody": _trials(Trying.UNTRIED),
    "cores on trial are killed": _trials(Trying.KILLED),
    "trials are slow": _trials(Trying.SLOW),
    "guard dies in court": _guard_dies_in_court,
    "core is killed in court": _killed_in_court,
    "letter is released": _letter_is_released,
    "letter is released a day later": _letter_is_released_a_day_later,
    "a full batch dies": _batch_dies,
    "copy for the court is slow": _trials(Trying.COPIES),
    "rule waits for the disk": _rule_waits_for_the_disk,
}
