"""The archive's values as the JSON that programs rely on: the API of `/admin/api/` and `hardcore dlq --json`."""

from collections.abc import Callable, Mapping
from typing import Any

from msgspec import structs

from frontend import catalogue_letters as texts
from postmortem.dead_letters.masking import shown
from postmortem.views import Group, Letter, Page, Proposal, Refusal

#: Refusals that are about what is not there, what must be said better, and who is away; all others are conflicts.
_STATUSES: Mapping[str, int] = {
    "reason_needed": 422,
    "verb_unknown": 422,
    "nothing_matches": 422,
    "too_many": 422,
    "correction_unreadable": 422,
    "correction_same": 422,
    "correction_masked": 422,
    "not_readable": 400,
    "not_found": 404,
    "ledger_away": 503,
    "guard_away": 503,
    "outcome_unknown": 503,
}


def letter(one: Letter, lang: str) -> dict[str, Any]:
    """A letter in a list, its secrets hidden. `attempts`: how many deaths and tries are known of it."""
    # A list says nothing of the contents, which may be large: so they are not looked at here.
    return _line(shown(structs.replace(one, payload=None, row=None)), lang)


def _line(one: Letter, lang: str) -> dict[str, Any]:
    return {
        "id": one.id,
        "command_id": one.command_id,
        "idempotency_key": one.idempotency_key,
        "kind": one.kind,
        "source": one.source,
        "reason": one.reason,
        "sentence": texts.told("reason", one.reason, lang),
        "next_step": texts.told("next", one.reason, lang),
        "accounts": list(one.account_ids),
        "attempts": len(one.attempts),
        "deaths": one.deaths,
        "incident_ids": list(one.incident_ids),
        "state": str(one.state),
        "quarantined_at": one.quarantined_at,
        "transaction_id": one.transaction_id,
        "method": one.method,
        "path": one.path,
        "sums": list(one.sums),
        "note": one.note,
        "discarded_because": one.discarded_because,
        "corrected_by": one.corrected_by,
        "dry_run": structs.asdict(one.dry_run) if one.dry_run is not None else None,
    }


def whole_letter(one: Letter, lang: str, *, revealed: bool = False) -> dict[str, Any]:
    """A letter with all that is known of it; its secrets only if it is `revealed`, which is written down."""
    one = one if revealed else shown(one)
    return {
        **_line(one, lang),
        "name": one.name,
        "fingerprint": one.fingerprint,
        "payload": one.payload,
        "row": dict(one.row) if one.row is not None else None,
        "seq": one.seq,
        "history": [structs.asdict(attempt) for attempt in one.attempts],
    }


def proposal(one: Proposal) -> dict[str, Any]:
    """A proposal."""
    return {**structs.asdict(one), "state": str(one.state)}


def group(one: Group) -> dict[str, Any]:
    """A group of equal deaths."""
    return {**structs.asdict(one), "standing": str(one.standing)}


def page(found: Page, told: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
    """A piece of a list."""
    return {"items": [told(one) for one in found.items], "total": found.total, "next_cursor": found.more}


def refusal(one: Refusal, lang: str) -> tuple[int, dict[str, Any]]:
    """A refusal as the status and the body of an answer."""
    status = _STATUSES.get(one.code, 404 if one.code.endswith("_unknown") else 409)
    sentence = texts.refusal(one.code, lang, one.values)
    return status, {
        "type": f"/problems/{one.code.replace('_', '-')}",
        "title": sentence,
        "status": status,
        "detail": sentence,
        "outcome": "unknown" if one.code == "outcome_unknown" else "not_done",
        **({"values": dict(one.values)} if one.values else {}),
    }
