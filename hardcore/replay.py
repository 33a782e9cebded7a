"""Asks the manager again: the facts of an incident go through the same code, and the orders must be the same.

A recording (`observations.jsonl`, see `recovery/flight.py`) begins with what the manager remembered; from there
on its orders follow from the facts alone. Where they differ, the code has changed since, or the recording has
been; either is worth knowing before a decision is explained to anybody. Whatever stands in the file, the answer
is a value: a recording is read, never run.

The same facts can be given to a second manager that goes by another policy. What it orders first that the other does
not is the answer; what would have come after that nobody knows, because other orders lead to other facts.
"""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec

from hardcore.model.codec import Json, Undecodable
from hardcore.model.observations import Observation, PolicyRead
from hardcore.model.phases import Wanted
from hardcore.recovery.failover import FailoverManager
from hardcore.recovery.flight import CODEC, RECORDING_BYTES_MAX, VERSION, digest, orders_told, resume
from hardcore.recovery.policy import Policy, in_full
from hardcore.snapshot.writer import RECORDING

#: Of an order or a reason, so much is shown.
SHOWN_MAX = 400
#: Orders by which nothing changes for whoever uses the ledger.
_NO_DEEDS = frozenset({"SampleStacks", "LookAtStore", "KeepBudget", "KeepCourt", "AddAudit", "AddTrials"})


class Difference(msgspec.Struct, frozen=True):
    """The first line (counted from 1) after which the orders differ, and both kinds of orders as JSON."""

    line: int
    fact: str
    recorded: str
    given: str


class Replayed(msgspec.Struct, frozen=True):
    """What came of asking again. `same`: every fact led to the orders that the recording tells.

    `facts` were heard, `orders` given. `cut_short`: the recording had grown too long and does not tell all.
    """

    same: bool
    facts: int
    orders: int
    cut_short: bool = False
    first_difference: Difference | None = None


class Compared(msgspec.Struct, frozen=True):
    """The first fact after which another policy leads to other orders; each order by its name. `fact` None: none does."""

    fact: str | None
    does: tuple[str, ...] = ()
    would: tuple[str, ...] = ()


class _BrokenError(ValueError):
    """The argument says why a recording can't be asked."""


class _Chance(msgspec.Struct):
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
    data = _recording(folder)
    return data if isinstance(data, str) else replay(data)


def compare_incident(folder: Path, policy: Policy) -> Compared | str:
    """Give an incident's facts to two managers, one with its own policy and one with this; a sentence where that fails."""
    data = _recording(folder)
    if isinstance(data, str):
        return data
    try:
        return _compare(data, policy, folder.name)
    except _BrokenError as broken:
        return f"{broken}."


def _recording(folder: Path) -> bytes | str:
    try:
        with (folder / RECORDING).open("rb") as file:
            return file.read(RECORDING_BYTES_MAX + 1)
    except FileNotFoundError:
        return f"This incident has no {RECORDING}: its guard ended before it was written."
    except OSError as error:
        return f"{RECORDING} can't be read: {error.strerror}."


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


def _compare(data: bytes, policy: Policy, incident: str) -> Compared:
    if len(data) > RECORDING_BYTES_MAX:
        raise _BrokenError(f"The recording is longer than {RECORDING_BYTES_MAX} bytes")
    head, *lines = _lines(data)
    from_ns = _began_ns(head, lines, incident)
    chances = (_Chance([], []), _Chance([], []))
    own, other = (_wake(head, chance) for chance in chances)
    told = False
    for number, line in enumerate(lines, start=2):
        if "end" in line:
            return Compared(None)
        if not told and _at_ns(line) >= from_ns:
            told = True
            other.receive(PolicyRead(from_ns, json.dumps(in_full(policy))))
            other.take_transitions()
            other.take_actions()  # what it does because of the change itself is no answer to a fact
        if told and _name_of(line) == PolicyRead.__name__:
            continue  # a change of policy back then is what is left out here
        does, would = (
            _names(_ask(manager, chance, line, number))
            for manager, chance in zip((own, other), chances, strict=True)
        )
        if does != would:
            return Compared(_name_of(line), does, would)
    raise _BrokenError("The recording has no end: it was cut off")


def _began_ns(head: dict[str, Json], lines: list[dict[str, Json]], incident: str) -> int:
    """Return when this incident's fault began, as the recorded manager saw it; 0 if the recording never has it open."""
    chance = _Chance([], [])
    manager = _wake(head, chance)
    for number, line in enumerate(lines, start=2):
        if "end" in line:
            break
        _ask(manager, chance, line, number)
        reading = manager.reading()
        if reading.incident == incident:
            return _at_ns(line) if reading.fault_ns is None else min(reading.fault_ns, _at_ns(line))
    return 0


def _at_ns(line: dict[str, Json]) -> int:
    """Return when a line's fact was true."""
    at_ns = line.get("deadline")
    fact = line.get("fact")
    if isinstance(fact, dict):
        told = next(iter(fact.values()), None)
        at_ns = told.get("at_ns") if isinstance(told, dict) else None
    return at_ns if isinstance(at_ns, int) else 0


def _names(given: list[Json]) -> tuple[str, ...]:
    """Return the names of orders that do something: looks, and what is only written down, are none."""
    names = (next(iter(order), "") for order in given if isinstance(order, dict))
    return tuple(sorted({name for name in names if name not in _NO_DEEDS}))


def _name_of(line: dict[str, Json]) -> str:
    fact = line.get("fact")
    return next(iter(fact), "") if isinstance(fact, dict) else "deadline"


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
    return Difference(number, _name_of(line), _short(line.get("orders", [])), _short(given))


def _short(value: Json) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    text = "".join(c if c.isprintable() else "?" for c in text)
    return text if len(text) <= SHOWN_MAX else text[: SHOWN_MAX - 1] + "…"
