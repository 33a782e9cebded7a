"""Asks the manager again: the facts of an incident go through the same code, and the orders must be the same.

A recording (`observations.jsonl`, see `recovery/flight.py`) begins with what the manager remembered; from there
on its orders follow from the facts alone. Where they differ, the code has changed since, or the recording has
been; either is worth knowing before a decision is explained to anybody. Whatever stands in the file, the answer
is a value: a recording is read, never run.
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hardcore.model.codec import Json, Undecodable
from hardcore.model.observations import Observation
from hardcore.model.phases import Wanted
from hardcore.recovery.failover import FailoverManager
from hardcore.recovery.flight import CODEC, RECORDING_BYTES_MAX, VERSION, digest, orders_told, resume
from hardcore.recovery.policy import Policy
from hardcore.snapshot.writer import RECORDING

#: Of an order or a reason, so much is shown.
SHOWN_MAX = 400


@dataclass(frozen=True, slots=True)
class Difference:
    """The first line (counted from 1) after which the orders differ, and both kinds of orders as JSON."""

    line: int
    fact: str
    recorded: str
    given: str


@dataclass(frozen=True, slots=True)
class Replayed:
    """What came of asking again. `same`: every fact led to the orders that the recording tells.

    `facts` were heard, `orders` given. `cut_short`: the recording had grown too long and does not tell all.
    """

    same: bool
    facts: int
    orders: int
    cut_short: bool = False
    first_difference: Difference | None = None


class _BrokenError(ValueError):
    """The argument says why a recording can't be asked."""


@dataclass(slots=True)
class _Chance:
    """Says what chance said then; a question too many is answered with nothing."""

    ids: list[str]
    jitters: list[float]

    def new_id(self) -> str:
        """The next id that was drawn."""
        return self.ids.pop(0) if self.ids else ""

    def jitter(self) -> float:
        """The next number that was drawn."""
        return self.jitters.pop(0) if self.jitters else 0.0


def replay_incident(folder: Path) -> Replayed | str:
    """Replay the recording in an incident's folder; a sentence where that can't be done."""
    try:
        with (folder / RECORDING).open("rb") as file:
            data = file.read(RECORDING_BYTES_MAX + 1)
    except FileNotFoundError:
        return f"This incident has no {RECORDING}: its guard ended before it was written."
    except OSError as error:
        return f"{RECORDING} can't be read: {error.strerror}."
    return replay(data)


def replay(data: bytes) -> Replayed | str:
    """Replay the lines of a recording; a sentence where that can't be done."""
    try:
        return _replay(data)
    except _BrokenError as broken:
        return f"{broken}."


def _replay(data: bytes) -> Replayed:
    if len(data) > RECORDING_BYTES_MAX:
        raise _BrokenError(f"The recording is longer than {RECORDING_BYTES_MAX} bytes")
    lines = _lines(data)
    chance = _Chance([], [])
    manager = _wake(next(lines), chance)
    facts = orders = 0
    difference = None
    for number, line in enumerate(lines, start=2):
        if "end" in line:
            _check_end(line, facts, last=next(lines, None) is None)
            return Replayed(difference is None, facts, orders, line.get("cut_short") is True, difference)
        facts += 1
        given = _ask(manager, chance, line, number)
        orders += len(given)
        if difference is None and given != line.get("orders", []):
            difference = _difference(number, line, given)
    raise _BrokenError(f"The recording has no end: it was cut off after {facts} facts")


def _lines(data: bytes) -> Iterator[dict[str, Json]]:
    for number, text in enumerate(data.splitlines(keepends=True) or [b""], start=1):
        try:
            line = json.loads(text) if text.endswith(b"\n") else None
        except (ValueError, RecursionError):
            line = None
        if not isinstance(line, dict):
            raise _BrokenError(f"Line {number} of the recording is cut off or is no JSON object")
        yield line


def _wake(head: dict[str, Json], chance: _Chance) -> FailoverManager:
    """Return a manager that remembers what the recorded one did."""
    if head.get("version") != VERSION:
        raise _BrokenError(
            f"Line 1 is of format {_short(head.get('version'))}, and this version reads {VERSION}"
        )
    if head.get("fault"):
        raise _BrokenError(f"The guard could not write down what it remembered: {_short(head['fault'])}")
    if digest(head.get("policy")) != head.get("policy_sha256"):
        raise _BrokenError("Line 1: the policy is not the one that was in force, its hash says")
    other = "" if head.get("shape") == CODEC.shape else " (it was recorded by another version of the guard)"
    policy, state = CODEC.decode(head.get("policy")), CODEC.decode(head.get("state"))
    for name, value, kind in (("policy", policy, Policy), ("state", state, dict)):
        if not isinstance(value, kind):
            why = value.reason if isinstance(value, Undecodable) else "it is something else"
            raise _BrokenError(f"Line 1: the {name} can't be read{other}: {why}")
    manager = FailoverManager(policy, Wanted.UP, chance.new_id, chance.jitter)
    fault = resume(manager, state)
    if fault is not None:
        raise _BrokenError(f"Line 1: {fault}{other}")
    return manager


def _ask(manager: FailoverManager, chance: _Chance, line: dict[str, Json], number: int) -> list[Json]:
    """Give the manager one line's fact; return its orders as a recording tells them."""
    deed = _deed(manager, line, number)
    chance.ids, chance.jitters = _drawn(line, "ids", str), _drawn(line, "jitters", float)
    try:
        deed()
        manager.take_transitions()
        return orders_told(manager.take_actions())
    except Exception as error:  # a recording may tell what no guard ever heard; that is said
        why = f"{type(error).__name__}: {error}"
        raise _BrokenError(f"Line {number}: the manager can't take this in: {_short(why)}") from error


def _deed(manager: FailoverManager, line: dict[str, Json], number: int) -> Callable[[], None]:
    at_ns = line.get("deadline")
    if isinstance(at_ns, int):
        return lambda: manager.handle_deadline(at_ns)
    fact = CODEC.decode(line.get("fact"))
    if isinstance(fact, Undecodable):
        raise _BrokenError(f"Line {number}: {fact.reason}")
    if not isinstance(fact, Observation):
        raise _BrokenError(f"Line {number} tells no fact")
    return lambda: manager.receive(fact)


def _drawn(line: dict[str, Json], name: str, kind: type) -> list[Any]:
    drawn = line.get(name, [])
    return [one for one in drawn if isinstance(one, kind)] if isinstance(drawn, list) else []


def _check_end(line: dict[str, Json], facts: int, *, last: bool) -> None:
    if line["end"] != facts:
        raise _BrokenError(f"The recording has {facts} facts and says that it has {_short(line['end'])}")
    if not last:
        raise _BrokenError("The recording goes on after its end")


def _difference(number: int, line: dict[str, Json], given: list[Json]) -> Difference:
    fact = line.get("fact")
    name = next(iter(fact)) if isinstance(fact, dict) else "deadline"
    return Difference(number, name, _short(line.get("orders", [])), _short(given))


def _short(value: Json) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    text = "".join(c if c.isprintable() else "?" for c in text)
    return text if len(text) <= SHOWN_MAX else text[: SHOWN_MAX - 1] + "…"
