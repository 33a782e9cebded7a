"""Poisonous commands, and what goes wrong with trials, by name."""

from collections.abc import Callable, Mapping

from hardcore.model.trials import RuleRemoved
from tests.simulation.clock import NS_PER_MS
from tests.simulation.harms import Harm
from tests.simulation.switches import Trying
from tests.simulation.world import World

Fault = Callable[[World], None]


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

    def kill() -> None:
        if (core := world.core) is not None and not world.quiet:
            core.signal(9)

    world.clock.after(world.rng.randrange(50, 2500) * NS_PER_MS, kill)


def _letter_is_released(world: World) -> None:
    """A person takes a rule away, and what it named comes again."""
    letters = [*world.set_aside.values()]
    if not letters:
        return
    letter = world.rng.choice(letters)
    world.set_aside = {name: one for name, one in world.set_aside.items() if one is not letter}
    if letter.seq is not None:
        world.store.parked.discard(letter.seq)
    world.to_guard(RuleRemoved(world.clock.now_ns, letter.id))
    again = next((x for x in world.gateway.requests if x.key_hash == letter.name and x.keyed), None)
    if again is not None:
        world.gateway.submit(again.key, harm=again.harm)


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
}
