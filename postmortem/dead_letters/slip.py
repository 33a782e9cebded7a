"""What the guard wrote of a letter, a drill, an act or a change of the state, read from its message into bounded values.

Pure, and total: a field of another shape is an empty one, a text is cut to its maximum, so that whatever a client sent
through the guard into the spool fills no row without end. Refusing a whole message for one odd field was not chosen: a
letter that is not shown is a request that nobody ever looks after. Only one without an id or a name is none.
"""

import re
from collections.abc import Mapping
from typing import Any, Final

import msgspec

from postmortem.dead_letters.payload import decoded, sums, without_secrets

TEXT_MAX: Final = 512
PATH_MAX: Final = 8_192
LIST_MAX: Final = 256
NUMBER_MAX: Final = (1 << 53) - 1

_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
_NAME = re.compile(r"[0-9a-f]{32}")
_HASH = re.compile(r"[0-9a-f]{64}")


class LetterSlip(msgspec.Struct, frozen=True):
    """One letter of the guard's. `case`: as in a docket, without headers that say who somebody is."""

    id: str
    held: bool
    reason: str
    name: str
    command_id: str
    idempotency_key: str | None
    kind: str
    source: str
    account_ids: tuple[str, ...]
    transaction_id: str
    fingerprint: str | None
    digest: str | None
    incident_ids: tuple[str, ...]
    deaths: int
    quarantined_at: str
    method: str
    path: str
    case: Mapping[str, Any] | None
    seq: int | None
    sums: tuple[str, ...]
    trial: Mapping[str, Any]


class DrillSlip(msgspec.Struct, frozen=True):
    """One drill that was run."""

    at: str
    fault: str
    ok: bool
    outage_ms: float | None
    incident: str | None
    scheduled: bool


class ActSlip(msgspec.Struct, frozen=True):
    """One act of somebody else's, for the audit log."""

    at: str
    who: str
    verb: str
    what: str
    reason: str


class StateSlip(msgspec.Struct, frozen=True):
    """One change of the state for people."""

    at: str
    before: str
    after: str
    phase: str
    reason: str


def letter(fields: Mapping[str, Any]) -> LetterSlip | None:
    """The letter of a message, or None where it has no id or no name."""
    identity, name = _text(fields.get("id")), _text(fields.get("name"))
    if not _ID.fullmatch(identity) or not _NAME.fullmatch(name):
        return None
    case = _mapping(fields.get("case"))
    kept = without_secrets(case) if case else None
    request, trial = _mapping(case.get("request")), _mapping(fields.get("trial"))
    seq = fields.get("seq", trial.get("seq"))
    transaction_id = _text(fields.get("transaction_id"))
    if request and transaction_id == _text(trial.get("transaction_id")):
        transaction_id = ""  # made up by the trial on its copy: it is in nobody's books
    return LetterSlip(
        id=identity,
        held=fields.get("state") == "HELD",
        reason=_text(fields.get("reason")) or "UNPROVEN",
        name=name,
        command_id=_text(fields.get("command_id")),
        idempotency_key=_text(fields.get("idempotency_key")) or None,
        kind=_text(fields.get("kind")),
        source=_text(fields.get("source")),
        account_ids=_texts(fields.get("account_ids")),
        transaction_id=transaction_id,
        fingerprint=_hash(fields.get("fingerprint")),
        digest=_hash(fields.get("digest")),
        incident_ids=tuple(one for one in _texts(fields.get("incident_ids")) if _ID.fullmatch(one)),
        deaths=_number(fields.get("deaths")) or 0,
        quarantined_at=_text(fields.get("quarantined_at")) or _text(fields.get("at")),
        method=_text(request.get("method"))[:16],
        path=_text(request.get("path"), PATH_MAX),
        case=kept,
        seq=_number(seq),
        sums=sums(decoded(kept)) if kept else (),
        trial=trial,
    )


def drill(fields: Mapping[str, Any]) -> DrillSlip:
    """The drill of a message."""
    return DrillSlip(
        at=_text(fields.get("at")),
        fault=_text(fields.get("fault")),
        ok=fields.get("ok") is True,
        outage_ms=_float(fields.get("outage_ms")),
        incident=_text(fields.get("incident")) or None,
        scheduled=fields.get("scheduled") is True,
    )


def act(fields: Mapping[str, Any]) -> ActSlip:
    """The act of a message."""
    return ActSlip(*(_text(fields.get(name)) for name in ("at", "who", "verb", "what", "reason")))


def state(fields: Mapping[str, Any]) -> StateSlip:
    """The change of the state of a message."""
    return StateSlip(*(_text(fields.get(name)) for name in ("at", "before", "after", "phase", "reason")))


def trial_words(trial: Mapping[str, Any]) -> tuple[str, str]:
    """What a trial's line says: its ordeal, and a sentence of where it ended."""
    ordeal, ending = _text(trial.get("ordeal")), _mapping(trial.get("exit"))
    signal, code = _number(ending.get("signal")), _number(ending.get("code"))
    parts = [
        f"signal {signal}" if signal else f"exit {code}" if code else "",
        _text(trial.get("frame")),
        _text(trial.get("why")),
    ]
    return ordeal, "; ".join(part for part in parts if part)


def _text(given: object, length_max: int = TEXT_MAX) -> str:
    if not isinstance(given, str):
        return ""
    # A lone surrogate can't be stored: said as an escape it is still to be seen.
    return given[:length_max].encode("utf-8", "backslashreplace").decode()


def _texts(given: object) -> tuple[str, ...]:
    many = given[:LIST_MAX] if isinstance(given, list) else []
    return tuple(dict.fromkeys(text for one in many if (text := _text(one))))


def _hash(given: object) -> str | None:
    text = _text(given)
    return text if _HASH.fullmatch(text) else None


def _number(given: object) -> int | None:
    fits = isinstance(given, int) and not isinstance(given, bool) and 0 <= given <= NUMBER_MAX
    return given if fits and isinstance(given, int) else None


def _float(given: object) -> float | None:
    fits = isinstance(given, int | float) and not isinstance(given, bool) and 0 <= given <= NUMBER_MAX
    return float(given) if fits and isinstance(given, int | float) else None


def _mapping(given: object) -> Mapping[str, Any]:
    return given if isinstance(given, dict) else {}
