"""Rows of the archive as the values that pages and printers read, and back.

Pure: a row in, a value out. What a row holds was bounded when it was written, so nothing here cuts or judges.
"""

import json
from collections.abc import Sequence

from sqlalchemy import RowMapping

from postmortem.dead_letters.payload import decoded
from postmortem.views import (
    Act,
    Attempt,
    Bulk,
    Drill,
    DryRun,
    Group,
    IncidentLine,
    Letter,
    LetterState,
    Proposal,
    ProposalState,
    Standing,
)


def incident(row: RowMapping) -> IncidentLine:
    """One incident of a list."""
    return IncidentLine(
        id=row["id"],
        opened_at=row["opened_at"],
        closed_at=row["closed_at"],
        diagnosis=row["diagnosis"],
        grade=row["grade"],
        summary=json.loads(row["summary"]),
        outcome=row["outcome"],
        outage_ms=row["outage_ms"],
        detected_ms=row["detected_ms"],
        fingerprint=row["fingerprint"],
        account_ids=tuple(json.loads(row["account_ids"])),
        planned=row["planned"],
        drill=row["drill"],
        note=row["note"],
    )


def group(row: RowMapping, merged: Sequence[str] = ()) -> Group:
    """One group of equal deaths; `merged`: those that were put into it."""
    return Group(
        fingerprint=row["fingerprint"],
        title=json.loads(row["title"]),
        diagnosis=row["diagnosis"],
        standing=Standing(row["standing"]),
        count=row["count"],
        first_at=row["first_at"],
        last_at=row["last_at"],
        median_outage_ms=row["median_outage_ms"],
        account_ids=tuple(json.loads(row["account_ids"])),
        fixed_in=row["fixed_in"],
        why=tuple(json.loads(row["why"])),
        newest=row["newest"],
        merged=tuple(merged),
    )


def letter(row: RowMapping, attempts: Sequence[RowMapping] = ()) -> Letter:
    """One letter; without its `attempts` for a list."""
    case = json.loads(row["case"]) if row["case"] else {}
    return Letter(
        id=row["id"],
        state=LetterState(row["state"]),
        reason=row["reason"],
        name=row["name"],
        command_id=row["command_id"],
        idempotency_key=row["idempotency_key"],
        kind=row["kind"],
        source=row["source"],
        account_ids=tuple(json.loads(row["account_ids"])),
        transaction_id=row["transaction_id"],
        fingerprint=row["fingerprint"],
        incident_ids=tuple(json.loads(row["incident_ids"])),
        deaths=row["deaths"],
        attempts=tuple(map(attempt, attempts)),
        quarantined_at=row["quarantined_at"],
        method=row["method"],
        path=row["path"],
        payload=decoded(case),
        row=case.get("row"),
        seq=row["seq"],
        dry_run=dry_run(row["dry_run"]),
        note=row["note"],
        discarded_because=row["discarded_because"],
        sums=tuple(json.loads(row["sums"])),
        corrected_by=row["corrected_by"] or "",
    )


def attempt(row: RowMapping) -> Attempt:
    """One death or try of a letter's request."""
    return Attempt(
        at=row["at"], what=row["what"], outcome=row["outcome"], incident=row["incident"], detail=row["detail"]
    )


def dry_run(text: str | None) -> DryRun | None:
    """What a throw-away core said of a letter, if it was asked."""
    return DryRun(**json.loads(text)) if text else None


def proposal(row: RowMapping, hits: int = 0, last_hit_at: str | None = None) -> Proposal:
    """One proposal; how often its rule refused stands in a file of the gateway's."""
    return Proposal(
        id=row["id"],
        incident=row["incident"],
        kind=row["kind"],
        text=json.loads(row["text"]),
        state=ProposalState(row["state"]),
        rule=json.loads(row["rule"]) if row["rule"] else None,
        tested=row["tested"],
        hits=hits,
        last_hit_at=last_hit_at,
        owner=row["owner"],
        note=row["note"],
    )


def act(row: RowMapping) -> Act:
    """One line of the audit log."""
    return Act(
        at=row["at"],
        who=row["who"],
        verb=row["verb"],
        what=row["what"],
        reason=row["reason"],
        outcome=row["outcome"],
    )


def drill(row: RowMapping) -> Drill:
    """One drill."""
    return Drill(
        at=row["at"],
        fault=row["fault"],
        ok=row["ok"],
        outage_ms=row["outage_ms"],
        incident=row["incident"],
        scheduled=row["scheduled"],
    )


def bulk(row: RowMapping, outcomes: Sequence[str | None]) -> Bulk:
    """Many letters at once; `outcomes` of each of them, None: not begun."""
    done = [outcome for outcome in outcomes if outcome is not None]
    return Bulk(
        id=row["id"],
        verb=row["verb"],
        total=len(outcomes),
        done=len(done),
        failed=sum(outcome != "done" for outcome in done),
        ended=row["ended"],
        current=row["current"],
    )
