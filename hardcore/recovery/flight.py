"""The flight recording: what the manager was told and what it ordered, so that it can be asked again.

The manager is a function of what it hears, so its state at one moment and every fact since then are the whole
truth about its decisions. The tape keeps two stretches of at most a minute each, every one with the state at its
beginning; when a third begins, the first is let go. A state is written down when a stretch begins, which is a
copy as well; facts and orders are frozen and are only kept, and written when an incident is (on another
thread, if the shell likes). One line for each tick in a file was not chosen: ten writes a second for ever, for the sake of
a minute now and then.

What clients wrote (payloads) and what a core said last in words is left out: no decision rests on it.
"""

import dataclasses
import hashlib
import importlib
import json
import types
from collections.abc import Callable, Iterable, Iterator
from enum import Enum
from typing import Any

import msgspec
from msgspec import structs

from hardcore.model import actions, observations, phases, recorder, verdicts
from hardcore.model.actions import Action
from hardcore.model.codec import Codec, Json, UnencodableError
from hardcore.model.observations import CoreExited, EvidenceTaken, Observation, Sampled
from hardcore.model.recorder import CommandNote, LastWords, Page
from hardcore.recovery import failover, policy
from hardcore.recovery.budget import NS_PER_S
from hardcore.recovery.failover import FailoverManager
from hardcore.settings import Limits

#: Of the format of a recording.
VERSION = 1
#: One stretch of the tape. Under load a look carries hundreds of commands: their number is bounded as well.
STRETCH_NS = 60 * NS_PER_S
FACTS_MAX = 2_048
NOTES_MAX = 8_192
#: A recording that would be longer is of the newer stretch alone, or ends early and says so.
RECORDING_BYTES_MAX = 6 << 20

#: Rooms whose values a state, a fact or an order may be made of.
_ROOMS = ("hardcore.model.", "hardcore.sentinel.", "hardcore.recovery.")


def _classes() -> Iterator[type]:
    """Every value class of the rooms that the manager's own room knows, directly or through others."""
    rooms = [failover, policy, observations, actions, verdicts, recorder, phases]
    for room in rooms:  # grows while it is walked
        for thing in vars(room).values():
            if isinstance(thing, types.ModuleType):
                known: Any = thing
            elif isinstance(thing, type) and thing.__module__.startswith(_ROOMS):
                known = importlib.import_module(thing.__module__)  # it is loaded: this finds it
                if dataclasses.is_dataclass(thing) or issubclass(thing, msgspec.Struct | Enum):
                    yield thing
            else:
                continue
            if known.__name__.startswith(_ROOMS) and known not in rooms:
                rooms.append(known)
    yield Limits


#: Nothing a client wrote or an exception quotes, nothing of a page that no decision rests on, and no channel's address.
CODEC = Codec(
    _classes(),
    {
        CommandNote: {"payload": b""},
        LastWords: {"text": ""},
        Page: {"events": (), "censuses": ()},
        policy.Policy: {"alerts": ()},
    },
)


def state_of(manager: FailoverManager) -> Json:
    """Return all that a manager remembers, or raise `UnencodableError`. Its orders must have been taken."""
    return CODEC.encode(dict(manager.state()))


def resume(manager: FailoverManager, state: dict[str, Any]) -> str | None:
    """Give a new manager what another one remembered, decoded; return what is wrong with that, if anything is."""
    own = manager.state()
    if strange := set(own) ^ set(state):
        return f"it remembers other things than this version: {', '.join(sorted(map(str, strange)))}"
    for name, value in state.items():
        if own[name] is not None and type(value) is not type(own[name]):
            return f"its {name} is a {type(value).__name__}"
    manager.resume(state)
    return None


class Entry(msgspec.Struct):
    """One fact (or the deadline's moment), what chance said meanwhile, and the orders."""

    heard: Observation | int
    ids: list[str] = msgspec.field(default_factory=list)
    jitters: list[float] = msgspec.field(default_factory=list)
    orders: tuple[Action, ...] = ()


class _Stretch(msgspec.Struct):
    """A state and the policy in force, or why there is none, and what was heard since."""

    began_ns: int
    state: Json
    policy: Json
    fault: str
    notes: int = 0
    entries: list[Entry] = msgspec.field(default_factory=list)


class Tape:
    """Keeps the last one to two minutes. `new_id` and `jitter` are given to the manager through it."""

    def __init__(self, new_id: Callable[[], str], jitter: Callable[[], float]) -> None:
        self._new_id = new_id
        self._jitter = jitter
        self._stretches: tuple[_Stretch, ...] = ()

    def new_id(self) -> str:
        """Return a new id, and remember it."""
        drawn = self._new_id()
        self._stretches[-1].entries[-1].ids.append(drawn)
        return drawn

    def jitter(self) -> float:
        """Return a number of chance, and remember it."""
        drawn = self._jitter()
        self._stretches[-1].entries[-1].jitters.append(drawn)
        return drawn

    def hear(self, heard: Observation | int, manager: FailoverManager) -> None:
        """Note a fact, or the moment of a deadline, just before the manager is given it."""
        at_ns = heard if isinstance(heard, int) else heard.at_ns
        if not self._stretches or self._is_over(self._stretches[-1], at_ns):
            self._stretches = (*self._stretches[-1:], self._begin(manager, at_ns))
        stretch = self._stretches[-1]
        stretch.notes += _notes(heard)
        stretch.entries.append(Entry(heard))

    def ordered(self, orders: tuple[Action, ...]) -> None:
        """Note what the manager ordered upon it."""
        entry = self._stretches[-1].entries[-1]
        entry.orders = (*entry.orders, *orders)

    def cut(self) -> "Recording":
        """Return what is on the tape at this moment. Cheap; the writing is `Recording.write`."""
        return Recording(tuple(structs.replace(one, entries=list(one.entries)) for one in self._stretches))

    def _begin(self, manager: FailoverManager, at_ns: int) -> _Stretch:
        try:
            return _Stretch(at_ns, state_of(manager), CODEC.encode(manager.policy), "")
        except UnencodableError as error:
            return _Stretch(at_ns, None, None, str(error))

    @staticmethod
    def _is_over(stretch: _Stretch, at_ns: int) -> bool:
        return (
            at_ns - stretch.began_ns >= STRETCH_NS
            or len(stretch.entries) >= FACTS_MAX
            or stretch.notes >= NOTES_MAX
        )


def _notes(heard: Observation | int) -> int:
    match heard:
        case Sampled(in_flight=notes):
            return len(notes or ())
        case CoreExited(page=Page(in_flight=notes)) | EvidenceTaken(page=Page(in_flight=notes)):
            return len(notes)
        case _:
            return 0


class Recording(msgspec.Struct, frozen=True):
    """What was on the tape at one moment. Writing it touches nothing that still changes."""

    stretches: tuple[_Stretch, ...]

    def write(self) -> bytes:
        """Return the lines of `observations.jsonl`; at most RECORDING_BYTES_MAX. Takes some 20 µs for each fact."""
        whole = self._from(self.stretches)
        if whole is None:
            whole = self._from(self.stretches[-1:])
        return whole if whole is not None else self._cut_short()

    def _from(self, stretches: tuple[_Stretch, ...]) -> bytes | None:
        lines, length = [], 0
        for line in self._lines(stretches):
            lines.append(line)
            length += len(line)
            if length > RECORDING_BYTES_MAX:
                return None
        return b"".join(lines)

    def _cut_short(self) -> bytes:
        lines, length = [], 0
        for line in self._lines(self.stretches[-1:]):
            length += len(line)
            if length > RECORDING_BYTES_MAX - 100:
                break
            lines.append(line)
        return b"".join([*lines, _line({"end": len(lines) - 1, "cut_short": True})])

    def _lines(self, stretches: tuple[_Stretch, ...]) -> Iterator[bytes]:
        first = stretches[0] if stretches else _Stretch(0, None, None, "nothing was heard yet")
        yield _line(
            {
                "version": VERSION,
                "shape": CODEC.shape,
                "began_ns": first.began_ns,
                "policy_sha256": digest(first.policy),
                "policy": first.policy,
                "state": first.state,
                **({"fault": first.fault} if first.fault else {}),
            }
        )
        facts = 0
        for stretch in stretches:
            for entry in stretch.entries:
                facts += 1
                yield _line(_told(entry))
        yield _line({"end": facts})


def digest(value: Json) -> str:
    """Return the SHA-256 of a JSON value, as its sorted text."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def _told(entry: Entry) -> dict[str, Json]:
    told: dict[str, Json] = {}
    if isinstance(entry.heard, int):
        told["deadline"] = entry.heard
    else:
        told["fact"] = CODEC.encode(entry.heard)
    if entry.ids:
        told["ids"] = entry.ids
    if entry.jitters:
        told["jitters"] = entry.jitters
    if entry.orders:
        told["orders"] = orders_told(entry.orders)
    return told


def orders_told(orders: Iterable[Action]) -> list[Json]:
    """Return orders as a recording tells them."""
    return [CODEC.encode(order) for order in orders]


def _line(value: Json) -> bytes:
    return json.dumps(value, separators=(",", ":")).encode() + b"\n"
