"""The feed's words: what the sentinel says to the gateway, what the gateway says back (JSON lines).

Bytes in, values out. A line that nobody can read is a value too (`Unreadable`), because a feed that ends
at the first odd line would leave the gateway blind. The meaning of a message is not decided here:
`standing` folds it into what the gateway knows. The wire is `docs/wires.md` section 6.
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from enum import StrEnum
from typing import Any, Protocol

import msgspec

from hardcore.model.phases import Face

#: The longest line either side may say. Suspects come in as many lines as they need, and add up.
LINE_BYTES_MAX = 64 << 10
#: Stages of a recovery that people are shown.
STAGES = 4
#: Requests in one line of outcomes; with paths cut at PATH_CHARS_MAX a line stays under LINE_BYTES_MAX.
OUTCOMES_PER_LINE = 64
PATH_CHARS_MAX = 200
_DIAGNOSIS = re.compile(r"[A-Z_]{1,40}")


class PhaseHeard(msgspec.Struct, frozen=True):
    """Where the guarded process is, and what that means to a request."""

    generation: int
    phase: str
    state: str
    face: Face
    incident: str | None
    stage: int | None = None
    since_ns: int = 0  # when the phase began, monotonic; 0: the line did not say
    planned: bool = False
    safe: str | None = None  # the diagnosis because of which the core serves reads only


class ServingHeard(msgspec.Struct, frozen=True):
    """Where the serving core listens."""

    generation: int
    socket: str
    epoch: int


class SuspectsHeard(msgspec.Struct, frozen=True):
    """Names that may only be looked up until their verdict. `account_ids`: what they would have touched."""

    generation: int
    keys: tuple[str, ...]
    account_ids: tuple[str, ...] = ()


class Verdict(StrEnum):
    """What came of a suspect's trial, in the words of the wire."""

    CLEARED = "cleared"
    CONVICTED = "convicted"
    HELD = "held"
    DROPPED = "dropped"

    @property
    def ends_case(self) -> bool:
        """Whether nobody needs the case any more: of what is set aside the guard makes a letter first."""
        return self in {Verdict.CLEARED, Verdict.DROPPED}


class VerdictHeard(msgspec.Struct, frozen=True):
    """A suspect is one no longer. `letter`: the number under which it is set aside."""

    generation: int
    name: str
    outcome: Verdict
    letter: str | None = None
    reason: str | None = None


class QuarantineHeard(msgspec.Struct, frozen=True):
    """There are other rules than before."""

    generation: int
    serial: int


class ReleaseHeard(msgspec.Struct, frozen=True):
    """Held and unanswered requests go on."""

    generation: int
    epoch: int
    incident: str | None


class VerifiedHeard(msgspec.Struct, frozen=True):
    """The whole ledger was proven behind the serving of `epoch`, or was found not to be whole."""

    generation: int
    epoch: int
    ok: bool


class AlertedHeard(msgspec.Struct, frozen=True):
    """Whether whoever runs the server was told of an incident: when the first message arrived, or that none did."""

    generation: int
    incident: str
    at: str | None
    failed: bool


class StandingHeard(msgspec.Struct, frozen=True):
    """How everything stands: what `hardcore status --json` says, and what was counted. Only the doors read it."""

    generation: int
    status: Mapping[str, Any]
    counters: Mapping[str, Any]


class Unreadable(msgspec.Struct, frozen=True):
    """A line that is none of the above, and why."""

    why: str


Heard = (
    PhaseHeard
    | ServingHeard
    | SuspectsHeard
    | ReleaseHeard
    | VerifiedHeard
    | VerdictHeard
    | QuarantineHeard
    | StandingHeard
    | AlertedHeard
)


def _text_or_none(value: object) -> str | None:
    return value if isinstance(value, str) else None


def _stage(value: object) -> int | None:
    """A stage of the recovery. One that this version does not know is none: it is only shown."""
    return value if isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= STAGES else None


def _diagnosis(value: object) -> str | None:
    """A diagnosis, also one that this version does not know. What can't be one is none: it is only shown."""
    return value if isinstance(value, str) and _DIAGNOSIS.fullmatch(value) else None


def _number(fields: Mapping[str, Any], name: str) -> int:
    value = fields[name]
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise ValueError(f"{name} is not a count")
    return value


def _text(fields: Mapping[str, Any], name: str) -> str:
    value = fields[name]
    if not isinstance(value, str):
        raise TypeError(f"{name} is not a text")
    return value


def _object(fields: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    value = fields[name]
    if not isinstance(value, dict):
        raise TypeError(f"{name} is not an object")
    return value


def _message(fields: Mapping[str, Any]) -> Heard:
    generation = _number(fields, "generation")
    match fields["type"]:
        case "phase":
            return PhaseHeard(
                generation,
                _text(fields, "phase"),
                _text(fields, "state"),
                Face(_text(fields, "face")),
                _text_or_none(fields.get("incident")),
                _stage(fields.get("stage")),
                _number(fields, "since_ns") if "since_ns" in fields else 0,
                fields.get("planned") is True,
                _diagnosis(fields.get("safe")),
            )
        case "serving":
            return ServingHeard(generation, _text(fields, "socket"), _number(fields, "epoch"))
        case "suspects":
            accounts = tuple(str(one) for one in fields.get("account_ids", ()))
            return SuspectsHeard(generation, tuple(str(key) for key in fields["keys"]), accounts)
        case "verdict":
            return VerdictHeard(
                generation,
                _text(fields, "name"),
                Verdict(_text(fields, "outcome")),
                _text_or_none(fields.get("letter")),
                _text_or_none(fields.get("reason")),
            )
        case "quarantine":
            return QuarantineHeard(generation, _number(fields, "serial"))
        case "release":
            return ReleaseHeard(generation, _number(fields, "epoch"), _text_or_none(fields.get("incident")))
        case "verified":
            return VerifiedHeard(generation, _number(fields, "epoch"), fields.get("ok") is True)
        case "alerted":
            at = _text_or_none(fields.get("at"))
            failed = at is None and fields.get("failed") is True
            return AlertedHeard(generation, _text(fields, "incident"), at, failed)
        case "standing":
            return StandingHeard(generation, _object(fields, "status"), _object(fields, "counters"))
        case other:
            raise ValueError(f"unknown type {other!r}")


def parse_line(line: bytes) -> Heard | Unreadable:
    """One line of the feed as a message."""
    try:
        fields = json.loads(line)
        if not isinstance(fields, dict):
            return Unreadable("not an object")
        return _message(fields)
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        return Unreadable(f"{type(error).__name__}: {error}")


class LineSplitter(msgspec.Struct):
    """Cuts a stream of bytes into lines, none longer than LINE_BYTES_MAX."""

    _rest: bytearray = msgspec.field(default_factory=bytearray)

    def feed(self, data: bytes) -> Iterator[bytes] | None:
        """The lines that are whole now; None: a line is too long, and the stream is worth nothing more."""
        self._rest += data
        *whole, rest = self._rest.split(b"\n")
        if len(rest) > LINE_BYTES_MAX or any(len(line) > LINE_BYTES_MAX for line in whole):
            return None
        self._rest = rest
        return (bytes(line) for line in whole if line.strip())


class Teller(Protocol):
    """Who brings our lines to the sentinel."""

    def say(self, line: bytes) -> bool:
        """Say a line; False if nobody listens."""

    def say_or_keep(self, line: bytes) -> None:
        """Say a line now, or to the next sentinel that listens."""


def _line(fields: Mapping[str, object]) -> bytes:
    return json.dumps(fields, separators=(",", ":")).encode() + b"\n"


def subscribe_line(pid: int) -> bytes:
    """The first thing the gateway says."""
    return _line({"verb": "subscribe", "who": "gateway", "pid": pid})


def holding_line(phase: str, at_ns: int) -> bytes:
    """Say that the gateway has begun to hold."""
    return _line({"type": "holding", "phase": phase, "at_ns": at_ns})


def witness_line(epoch: int, seq: int, digest: str) -> bytes:
    """Say which commit of `epoch` was passed on to a client: the highest so far."""
    return _line({"type": "witness", "epoch": epoch, "seq": seq, "hash": digest})


def case_line(name: str) -> bytes:
    """Say that a suspect's whole request lies among the cases."""
    return _line({"type": "case", "name": name})


def settled_line(names: Sequence[str]) -> bytes:
    """Say that these suspects are in the ledger."""
    return _line({"type": "settled", "names": list(names)})


def investigate_line() -> bytes:
    """Ask for the investigators: somebody wants their pages, and nobody listens there."""
    return _line({"type": "investigate"})


def asked_doors_line() -> bytes:
    """Say that somebody reads the doors, and that fresh numbers are wanted."""
    return _line({"type": "asked-doors"})


def overdue_line(path: str, epoch: int, age_ms: int) -> bytes:
    """Say that the core of `epoch` has not answered in time: its client was told 504."""
    return _line({"type": "overdue", "path": path[:PATH_CHARS_MAX], "epoch": epoch, "age_ms": age_ms})


def served_line(epoch: int, at_ns: int) -> bytes:
    """Say that the first answer of `epoch` came through."""
    return _line({"type": "served", "epoch": epoch, "at_ns": at_ns})


def stats_line(*, held: int, connections: int, websockets: int, forwarded: int) -> bytes:
    """Say how much is going on at this moment."""
    counts = {"held": held, "connections": connections, "websockets": websockets, "forwarded": forwarded}
    return _line({"type": "stats", **counts})


class Settled(msgspec.Struct, frozen=True):
    """What became of one request that met an outage. `outcome` is a word of the wire."""

    method: str
    path: str
    key_hash: str | None
    outcome: str
    status: int
    held_ms: int


def _settled_fields(one: Settled) -> dict[str, object]:
    return {
        "method": one.method,
        "path": one.path[:PATH_CHARS_MAX],
        "key_hash": one.key_hash,
        "outcome": one.outcome,
        "status": one.status,
        "held_ms": one.held_ms,
    }


def outcomes_lines(incident: str | None, requests: Sequence[Settled]) -> Iterator[bytes]:
    """Say what became of each request that met the outage: at least one line, an empty one if none did."""
    for start in range(0, max(1, len(requests)), OUTCOMES_PER_LINE):
        part = requests[start : start + OUTCOMES_PER_LINE]
        yield _line(
            {"type": "outcomes", "incident": incident, "requests": [_settled_fields(r) for r in part]}
        )
