"""What a guard may order its core to do, read from one JSON line. Pure.

Whatever changes something carries the generation of the sentinel that gives the order, and one that is older
than another already seen is refused: a sentinel that woke up late must not break a core that a newer one looks
after. Questions need none. A line that is no order is a value with a sentence, never an exception.
"""

import json
import re
from collections.abc import Mapping
from typing import Any, Final, TypeGuard, assert_never

import msgspec

from core.guarded.drills import Drill
from core.guarded.environment import WITNESSES_MAX, LastSeen

DISK_FULL_S: Final = 3
DISK_FULL_S_MAX: Final = 60
WAIT_MS_MAX: Final = 600_000
LEAK_MB_PER_S: Final = 8
LEAK_MB_PER_S_MAX: Final = 1_024
LEAK_S: Final = 600
LEAK_S_MAX: Final = 86_400
_NUMBER_MAX: Final = 2**63 - 1
_REASON: Final = re.compile(r"[A-Z_]{1,40}")
_COMPONENT: Final = re.compile(r"[a-z][a-z-]{0,23}")


class StatusOrder(msgspec.Struct, frozen=True):
    """Asks where the core stands."""


class TasksOrder(msgspec.Struct, frozen=True):
    """Asks what waits on the event loop."""


class SafeOrder(msgspec.Struct, frozen=True):
    """Has the core serve reads only because of a diagnosis (`reason`), or everything again."""

    on: bool
    reason: str
    generation: int


class DrillOrder(msgspec.Struct, frozen=True):
    """Has the core break itself.

    `armed`: the guard has bounded this process's memory, so it may be used up. `seconds`: how long `diskfull` and
    `leak` last. `mb_per_s`: what `leak` takes; 0 gives back what it has taken. `component`: what `stall` stalls.
    """

    drill: Drill
    generation: int
    armed: bool = False
    seconds: int = DISK_FULL_S
    mb_per_s: int = LEAK_MB_PER_S
    component: str = ""


class PromoteOrder(msgspec.Struct, frozen=True):
    """Has a spare take over.

    `expected_epoch`: the predecessor's; None: raise whatever stands in the store. `witnesses`: commits that somebody
    saw. `busy_ms`: how long the fence waits for the store's lock; None: as the core's settings say.
    """

    expected_epoch: int | None
    witnesses: tuple[LastSeen, ...]
    busy_ms: int | None
    generation: int


class DrainOrder(msgspec.Struct, frozen=True):
    """Has the core take nothing new, finish what it has within `within_ms`, and let go of the store."""

    within_ms: int
    generation: int


class QuarantineOrder(msgspec.Struct, frozen=True):
    """Has the core read the rules anew, and what is armed for a drill."""

    generation: int


class ComponentOrder(msgspec.Struct, frozen=True):
    """Has the core end one of its components and begin it anew; everything else goes on."""

    name: str
    generation: int


class CheckpointOrder(msgspec.Struct, frozen=True):
    """Has the core make a checkpoint of the ledger now."""

    generation: int


class Refused(msgspec.Struct, frozen=True):
    """An order that is not carried out, and why."""

    error: str


Order = (
    StatusOrder
    | TasksOrder
    | SafeOrder
    | DrillOrder
    | PromoteOrder
    | DrainOrder
    | QuarantineOrder
    | ComponentOrder
    | CheckpointOrder
    | Refused
)


def read_order(line: bytes, lowest_generation: int) -> Order:
    """Return the order on one line; never raises. Orders below `lowest_generation` are refused."""
    try:
        said = json.loads(line)
    except (ValueError, RecursionError):
        return Refused("The line is not JSON.")
    if not isinstance(said, dict):
        return Refused("The line is not a JSON object.")
    match said.get("verb"):
        case "status":
            return StatusOrder()
        case "tasks":
            return TasksOrder()
        case "safe":
            return _read_safe(said, lowest_generation)
        case "drill":
            return _read_drill(said, lowest_generation)
        case "promote":
            return _read_promote(said, lowest_generation)
        case "drain":
            return _read_drain(said, lowest_generation)
        case "quarantine":
            generation = _generation(said, lowest_generation)
            return generation if isinstance(generation, Refused) else QuarantineOrder(generation)
        case "component":
            return _read_component(said, lowest_generation)
        case "checkpoint":
            generation = _generation(said, lowest_generation)
            return generation if isinstance(generation, Refused) else CheckpointOrder(generation)
        case _:
            return Refused(
                "The verb must be status, tasks, safe, drill, promote, drain, quarantine, component or checkpoint."
            )


def generation_of(order: Order) -> int:
    """Return the generation that gave this order, 0 for what needs none."""
    match order:
        case SafeOrder() | DrillOrder() | PromoteOrder() | DrainOrder() | QuarantineOrder():
            return order.generation
        case ComponentOrder() | CheckpointOrder():
            return order.generation
        case StatusOrder() | TasksOrder() | Refused():
            return 0
        case _:
            assert_never(order)


def _read_safe(said: Mapping[str, Any], lowest: int) -> SafeOrder | Refused:
    on, reason = said.get("on"), said.get("reason")
    if not isinstance(on, bool):
        return Refused("To be safe is on or not: on must be true or false.")
    if not isinstance(reason, str) or _REASON.fullmatch(reason) is None:
        return Refused("The reason must be a diagnosis in capitals.")
    generation = _generation(said, lowest)
    return generation if isinstance(generation, Refused) else SafeOrder(on, reason, generation)


def _read_component(said: Mapping[str, Any], lowest: int) -> ComponentOrder | Refused:
    name = said.get("name")
    if not isinstance(name, str) or _COMPONENT.fullmatch(name) is None:
        return Refused("The name must be that of a component.")
    generation = _generation(said, lowest)
    return generation if isinstance(generation, Refused) else ComponentOrder(name, generation)


def _read_drill(said: Mapping[str, Any], lowest: int) -> DrillOrder | Refused:
    fault = said.get("fault")
    if not isinstance(fault, str) or fault not in set(Drill):
        return Refused(f"The fault must be one of {', '.join(Drill)}.")
    generation = _generation(said, lowest)
    if isinstance(generation, Refused):
        return generation
    match Drill(fault):
        case Drill.LEAK:
            return _read_leak(said, generation)
        case Drill.STALL:
            return _read_stall(said, generation)
        case drill:
            return _read_plain_drill(said, drill, generation)


def _read_plain_drill(said: Mapping[str, Any], drill: Drill, generation: int) -> DrillOrder | Refused:
    armed, seconds = said.get("armed", False), said.get("seconds", DISK_FULL_S)
    if not isinstance(armed, bool):
        return Refused("Armed must be true or false.")
    if not _is_within(seconds, 1, DISK_FULL_S_MAX):
        return Refused(f"The seconds must be a whole number from 1 to {DISK_FULL_S_MAX}.")
    if drill is Drill.OOM and not armed:
        return Refused("Memory is used up only where the guard has bounded it: the order must be armed.")
    return DrillOrder(drill, generation, armed, seconds)


def _read_leak(said: Mapping[str, Any], generation: int) -> DrillOrder | Refused:
    mb_per_s, seconds = said.get("mb_per_s", LEAK_MB_PER_S), said.get("seconds", LEAK_S)
    if not _is_within(mb_per_s, 0, LEAK_MB_PER_S_MAX):
        return Refused(f"The megabytes a second must be a whole number from 0 to {LEAK_MB_PER_S_MAX}.")
    if not _is_within(seconds, 1, LEAK_S_MAX):
        return Refused(f"The seconds must be a whole number from 1 to {LEAK_S_MAX}.")
    return DrillOrder(Drill.LEAK, generation, seconds=seconds, mb_per_s=mb_per_s)


def _read_stall(said: Mapping[str, Any], generation: int) -> DrillOrder | Refused:
    component = said.get("component")
    if not isinstance(component, str) or _COMPONENT.fullmatch(component) is None:
        return Refused("What is to be stalled must be the name of a component.")
    return DrillOrder(Drill.STALL, generation, component=component)


def _read_promote(said: Mapping[str, Any], lowest: int) -> PromoteOrder | Refused:
    expected, busy_ms = said.get("expected_epoch"), said.get("busy_ms")
    if expected is not None and not _is_within(expected, 0, _NUMBER_MAX):
        return Refused("The expected epoch must be a whole number or null.")
    if busy_ms is not None and not _is_within(busy_ms, 1, WAIT_MS_MAX):
        return Refused(f"The wait for the lock must be a whole number from 1 to {WAIT_MS_MAX}, or null.")
    witnesses = _witnesses(said.get("witnesses"))
    if witnesses is None:
        return Refused(f"The witnesses must be a list of at most {WITNESSES_MAX} texts sequence:epoch:hash.")
    generation = _generation(said, lowest)
    if isinstance(generation, Refused):
        return generation
    return PromoteOrder(expected, witnesses, busy_ms, generation)


def _witnesses(told: object) -> tuple[LastSeen, ...] | None:
    if not isinstance(told, list) or len(told) > WITNESSES_MAX:
        return None
    read = [LastSeen.read(text) if isinstance(text, str) else None for text in told]
    seen = tuple(one for one in read if one is not None)
    return seen if len(seen) == len(read) else None


def _read_drain(said: Mapping[str, Any], lowest: int) -> DrainOrder | Refused:
    within_ms = said.get("within_ms")
    if not _is_within(within_ms, 1, WAIT_MS_MAX):
        return Refused(f"The time to drain in must be a whole number from 1 to {WAIT_MS_MAX}.")
    generation = _generation(said, lowest)
    return generation if isinstance(generation, Refused) else DrainOrder(within_ms, generation)


def _generation(said: Mapping[str, Any], lowest: int) -> int | Refused:
    generation = said.get("generation")
    if not _is_within(generation, 0, _NUMBER_MAX):
        return Refused("The generation must be a whole number.")
    if generation < lowest:
        return Refused(f"Generation {generation} is over: {lowest} gives the orders.")
    return generation


def _is_within(value: object, least: int, most: int) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool) and least <= value <= most
