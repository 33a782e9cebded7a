"""What changes what the guard may do, and what it does beside a core that goes on: wishes, modes, parts, memory.

The operator may want reads only at any moment, and take that back at any other. A policy that is read anew may forbid in
the middle of a recovery what was begun in act. A part of the core may stand still while the ledger answers.
"""

import dataclasses
import json
from collections.abc import Callable, Mapping
from functools import partial

from hardcore.model import observations as seen
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.policy import in_full
from tests.simulation.clock import NS_PER_MS, NS_PER_S
from tests.simulation.spare_faults import operator_asks
from tests.simulation.store_faults import end_the_present_one, later
from tests.simulation.world import World

Fault = Callable[[World], None]
MODES = ("assist", "observe")


def take_live(world: World, mode: str) -> None:
    """Another mode holds from now on; who begins later finds it on the disk."""
    world.policy = dataclasses.replace(world.policy, mode=mode)
    if world.guard.works:
        text = json.dumps(in_full(world.policy))
        world.guard.tell(seen.PolicyRead(world.clock.now_ns, text))


def _mode(world: World) -> None:
    take_live(world, world.rng.choice(MODES))
    if world.rng.random() < 0.5:
        end_the_present_one(world)
    if world.rng.random() < 0.5:
        verb = world.rng.choice([seen.Verb.RESUME, seen.Verb.RESTART, seen.Verb.RESTART_HARD])
        later(world, 500, 6000, partial(operator_asks, world, verb))
    if world.rng.random() < 0.5:
        later(world, 500, 9000, partial(take_live, world, "act"))


def _reads_only(world: World) -> None:
    operator_asks(world, seen.Verb.SAFE_ON)
    if world.rng.random() < 0.4:
        end_the_present_one(world)
    if world.rng.random() < 0.6:
        later(world, 1, 6000, partial(operator_asks, world, seen.Verb.SAFE_OFF))


def _part_stalls(world: World) -> None:
    core = world.core
    if core is None:
        return
    core.part_stalled_ns = world.clock.now_ns
    world.switches.part_again = world.rng.randrange(6)
    world.is_true(Diagnosis.COMPONENT_STALLED)
    world.worry()


def _grows(world: World) -> None:
    """Its memory grows above the limit: worth saying, and another core in a calm moment."""
    if (core := world.core) is None:
        return
    core.rss_bytes += 1 << 30
    world.worry()
    for second in range(15):
        here = world.rng.randrange(2)
        count = partial(_count, world, here)
        world.clock.after(second * NS_PER_S + NS_PER_MS, count)


def _count(world: World, connections: int) -> None:
    world.to_guard(seen.GatewayCounted(world.clock.now_ns, connections, 0, len(world.gateway.requests)))


MANDATE: Mapping[str, Fault] = {
    "mode changes": _mode,
    "operator reads only": _reads_only,
    "a part stands still": _part_stalls,
    "memory grows": _grows,
}
