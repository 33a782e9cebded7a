"""An incident as the facts of `incident.json`: times become wall times and offsets, notes become objects.

Pure but for `wall`, which is given: the story itself only knows the monotonic clock.
"""

from collections.abc import Callable, Iterable, Mapping
from datetime import UTC, datetime
from types import MappingProxyType
from typing import Any

from hardcore.model.actions import Incident
from hardcore.model.observations import Exit, LedgerAudited, RequestOutcome
from hardcore.model.recorder import CommandNote
from hardcore.model.trials import TrialNote
from hardcore.model.verdicts import Grade
from hardcore.snapshot.masking import mask_line

VERSION = 1
#: The outcome of an incident whose guard ended before it was over.
ABANDONED = "abandoned"
_MS = 1_000_000


def facts(
    incident: Incident,
    pid: int | None,
    nonce: str,
    wall: Callable[[int], str],
    ran: Mapping[str, object] = MappingProxyType({}),
) -> dict[str, Any]:
    """Return the facts of an incident, an open one has no time of closing. `wall` makes RFC 3339 of a monotonic time.

    `ran`: the code, the store's schema and the policy, under the names of the facts.
    """
    steps = dict(incident.timeline)
    fault = steps["fault"]
    return {
        "version": VERSION,
        "id": incident.id,
        "opened_at": wall(incident.opened_ns),
        "closed_at": wall(incident.closed_ns) if incident.closed_ns else None,
        "outcome": incident.outcome,
        "diagnosis": str(incident.diagnosis),
        "grade": str(incident.grade),
        "evidence": [
            {"kind": fact.witness, "colour": str(fact.colour), "text": fact.why} for fact in incident.evidence
        ],
        "planned": incident.planned,
        "drill": incident.drill,
        "reason": incident.reason or None,
        "timeline": [
            {"at": wall(at), "offset_ms": round((at - fault) / _MS, 1), "step": step}
            for step, at in incident.timeline
        ],
        "detected_ms": round((steps["detected"] - fault) / _MS, 1) if "detected" in steps else None,
        "outage_ms": round((steps["serving"] - fault) / _MS, 1) if "serving" in steps else None,
        "core": {"pid": pid, "nonce": nonce, "epoch": incident.epoch, "exit": _exit(incident.exit)},
        "last_words": (
            {"code": incident.last_words.code, "text": mask_line(incident.last_words.text)}
            if incident.last_words
            else None
        ),
        "in_flight": [_note(note, steps.get("detected", fault)) for note in incident.in_flight],
        "suspects": list(incident.suspects),
        "blamed": list(incident.blamed),
        "requests": requests(incident.requests),
        "proof": _proof(incident),
        "audit": audit(incident.audit, wall) if incident.audit else None,
        "deaths": [
            {"at": wall(death.at_ns), "diagnosis": str(death.diagnosis), "exit": _exit(death.exit)}
            for death in incident.deaths
        ],
        "next_epoch": incident.next_epoch,
        "waits_for": str(incident.waits_for) if incident.waits_for else None,
        "trials": trials(incident.trials),
        **ran,
    }


def trials(notes: Iterable[TrialNote]) -> list[dict[str, Any]]:
    """Return what came of the trials of an incident's suspects, in the form of the facts."""
    return [
        {
            "name": note.name,
            "command_id": note.command_id,
            "ordeal": str(note.ordeal),
            "letter": note.letter or None,
            "took_ms": note.took_ms,
            "why": note.why,
            "fingerprint": note.fingerprint or None,
            "kind": note.kind,
            "account_ids": list(note.account_ids),
            "transaction_id": note.transaction_id,
        }
        for note in notes
    ]


def requests(settled: Iterable[RequestOutcome]) -> list[dict[str, Any]]:
    """Return what became of requests, in the form of the facts."""
    return [
        {
            "method": request.method,
            "path": request.path,
            "key_hash": request.key_hash,
            "outcome": request.outcome,
            "status": request.status,
            "held_ms": request.held_ms,
        }
        for request in settled
    ]


def audit(told: LedgerAudited, wall: Callable[[int], str]) -> dict[str, Any]:
    """Return what the proof of the whole ledger said, in the form of the facts."""
    return {"at": wall(told.at_ns), "ok": told.ok, "seq": told.seq, "fault": told.fault or None}


def abandoned(incident_id: str, closed_at: str, page: Mapping[str, Any]) -> dict[str, Any]:
    """Return the closing facts of an incident whose guard died, from the `recorder.json` in its folder.

    Nobody saw how it ended; that a core served again is added when one does. Which commands were in flight is read from the page itself, as in any report.
    """
    beats = page.get("beats")
    return {
        "version": VERSION,
        "id": incident_id,
        "opened_at": _id_time(incident_id),
        "closed_at": closed_at,
        "outcome": ABANDONED,
        "diagnosis": "UNKNOWN",
        "grade": str(Grade.UNKNOWN),
        "evidence": [{"kind": "guard", "text": "the guard itself ended before this incident was over"}],
        "core": {
            "pid": page.get("pid"),
            "nonce": page.get("nonce"),
            "epoch": beats.get("epoch") if isinstance(beats, dict) else None,
            "exit": None,
        },
        "last_words": page.get("last_words"),
    }


def left_open(
    known: Mapping[str, Any], closing: Mapping[str, Any], released_at: str | None = None
) -> dict[str, Any]:
    """Return the closing facts of an incident whose guard died, from what was `known` of it while it was open.

    `released_at`: when that guard had requests go to a core again, if it lived to do it.
    """
    if not known:
        return dict(closing)
    evidence = known.get("evidence")
    told = evidence if isinstance(evidence, list) else []
    whole = {
        **closing,
        **{name: value for name, value in known.items() if name != "released_at"},
        "closed_at": closing["closed_at"],
        "outcome": ABANDONED,
        "evidence": [*told, *closing["evidence"]],
        "last_words": known.get("last_words") or closing["last_words"],
    }
    return whole if released_at is None else served_again(whole, released_at)


def served_again(told: Mapping[str, Any], at: str) -> dict[str, Any]:
    """Return the facts of an incident after which a core served at `at`, though nobody saw it to its end."""
    if told.get("outcome") != ABANDONED or told.get("outage_ms") is not None or not stops(told):
        return {**told, "served_again_at": at}
    fault = next((step.get("at") for step in told.get("timeline", ()) if step.get("step") == "fault"), None)
    return {**told, "served_again_at": at, "outage_ms": _apart_ms(fault, at)}


def stops(told: Mapping[str, Any]) -> bool:
    """Tell whether people had to wait in an incident: its core ended, or was asked to make room for another."""
    return bool(told.get("deaths")) or told.get("planned") is True


def in_the_middle(told: Mapping[str, Any], other: str) -> dict[str, Any]:
    """Return the facts of a guard's end in the middle of another incident: people were waiting already."""
    line = {"kind": "guard", "colour": "yellow", "text": f"it ended in the middle of incident {other}"}
    return {**told, "left_open": other, "evidence": [*told["evidence"], line]}


def _apart_ms(first: object, second: str) -> float | None:
    try:
        passed = datetime.fromisoformat(second) - datetime.fromisoformat(str(first))
    except (ValueError, TypeError):
        return None
    return max(0.0, round(passed.total_seconds() * 1000, 1))


def _id_time(incident_id: str) -> str | None:
    """Return the wall time that is the first part of an incident's id."""
    try:
        at_ms = int(incident_id.replace("-", "")[:12], 16)
        at = datetime.fromtimestamp(at_ms / 1000, UTC)
    except (ValueError, OverflowError, OSError):
        return None
    return at.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _exit(how: Exit | None) -> dict[str, int] | None:
    if how is None:
        return None
    if how.signal is not None:
        return {"signal": how.signal}
    return {"code": how.code} if how.code is not None else None


def _note(note: CommandNote, at_ns: int) -> dict[str, Any]:
    return {
        "command_id": note.command_id,
        "kind": note.kind,
        "stage": note.stage.name,
        "transaction_id": note.transaction_id,
        "account_ids": list(note.account_ids),
        "key_hash": note.key_hash,
        "age_ms": max(0, (at_ns - note.started_ns) // _MS) if note.started_ns else None,
    }


def _proof(incident: Incident) -> dict[str, Any] | None:
    proof = incident.proof
    if proof is None:
        return None
    return {
        "kind": proof.kind,
        "tail": proof.tail,
        "seq": proof.seq,
        "epoch": incident.next_epoch,
        "hash": proof.hash,
        "witness_seq": incident.witness.seq if incident.witness else None,
    }
