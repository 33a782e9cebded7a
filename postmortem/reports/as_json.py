"""Prints a report as the JSON that programs rely on: an item of the list, and the whole story."""

from typing import Any

import msgspec
from msgspec import structs

from frontend import catalogue_reports as texts
from postmortem.analyzer.case import Thread
from postmortem.analyzer.fingerprint import is_own
from postmortem.incident import at_work
from postmortem.reports.report import (
    Report,
    change_line,
    culprit_line,
    finding_line,
    next_step,
    no_requests,
    outage_word,
    proposal_text,
    repetition_line,
    request_word,
)

#: Of the stacks, what is worth telling beside the file they stand in.
THREADS_MAX, FRAMES_MAX = 32, 24
#: Points of the memory curve.
POINTS_MAX = 240


def as_item(report: Report, language: str) -> dict[str, Any]:
    """Return the report as one item of the list of incidents."""
    incident = report.incident
    return {
        "id": incident.id,
        "opened_at": incident.opened_at,
        "closed_at": incident.closed_at,
        "fingerprint": report.fingerprint,
        "build": incident.versions.build,
        "policy_sha256": incident.versions.policy,
        "schema": incident.versions.schema,
        "diagnosis": incident.diagnosis,
        "grade": incident.grade,
        "summary": report.summary[language],
        "account_ids": list(report.account_ids),
        "transaction_ids": list(report.transaction_ids),
        "command_ids": list(report.command_ids),
        "outage_ms": incident.outage_ms,
        "detected_ms": incident.detected_ms,
        "outcome": incident.outcome,
        "served_again_at": incident.served_again_at,
        "planned": incident.planned,
        "evidence_complete": report.contents.complete,
        "money": structs.asdict(report.money),
    }


def as_story(report: Report, language: str) -> dict[str, Any]:
    """Return the whole report."""
    incident = report.incident
    return {
        **as_item(report, language),
        "summaries": dict(report.summary),
        "reason": incident.reason,
        "waits_for": incident.waits_for,
        "next_step": {one: next_step(incident, one) for one in texts.LANGUAGES},
        "drill": incident.drill,
        "timeline": [structs.asdict(step) for step in incident.timeline],
        "evidence": [{"kind": line.code, "text": line.text} for line in incident.evidence],
        "findings": [
            {
                "rule": finding.rule,
                "confidence": str(finding.confidence),
                "sentence": {one: finding_line(finding, one) for one in texts.LANGUAGES},
                "evidence": list(finding.evidence),
                "account_ids": list(finding.account_ids),
                "transaction_ids": list(finding.transaction_ids),
            }
            for finding in report.findings
        ],
        "title": dict(report.title),
        "why": list(report.print_of.why),
        "fingerprint_version": report.print_of.version,
        "culprit": _culprit(report),
        "trials": [structs.asdict(trial) for trial in incident.trials],
        "waits": [structs.asdict(wait) for wait in report.waits],
        "stacks": [_stack(thread) for thread in report.threads[:THREADS_MAX]],
        "memory": {"points": _points(report), "limit_bytes": report.memory_limit_bytes},
        "repetition": structs.asdict(report.repetition) if report.repetition else None,
        "repetition_line": {one: repetition_line(report.repetition, one) for one in texts.LANGUAGES},
        "changes": [
            structs.asdict(change) | {"text": {one: change_line(change, one) for one in texts.LANGUAGES}}
            for change in report.changes or ()
        ],
        "proposals": [
            {
                "id": proposed.id,
                "kind": proposed.kind,
                "text": {one: proposal_text(proposed, one) for one in texts.LANGUAGES},
                "rule": dict(proposed.rule) if proposed.rule is not None else None,
                "tested": None,
            }
            for proposed in report.proposals
        ],
        "requests": [
            structs.asdict(request)
            | {"told": {one: request_word(incident, request, one) for one in texts.LANGUAGES}}
            for request in incident.requests
        ],
        "no_requests": {one: no_requests(incident, one) for one in texts.LANGUAGES},
        "no_outage": {one: outage_word(incident, one) for one in texts.LANGUAGES},
        "in_flight": [structs.asdict(command) for command in at_work(incident)],
        "suspects": list(incident.suspects),
        "blamed": list(incident.blamed),
        "core": {
            "pid": incident.pid,
            "epoch": incident.epoch,
            "next_epoch": incident.next_epoch,
            "exit": structs.asdict(incident.exit),
            "last_words": structs.asdict(incident.last_words) if incident.last_words else None,
        },
        "deaths": msgspec.to_builtins(incident.deaths),
        "proof": structs.asdict(incident.proof) if incident.proof else None,
        "audit": structs.asdict(incident.audit) if incident.audit else None,
        "bundle": structs.asdict(report.contents) | {"faults": list(report.contents.faults)},
    }


def _culprit(report: Report) -> dict[str, Any]:
    """Return the command behind it, or with all fields empty that none is named, and why in words."""
    culprit = report.culprit
    return {
        "command_id": culprit.command_id if culprit else "",
        "kind": culprit.kind if culprit else "",
        "transaction_id": culprit.transaction_id if culprit else "",
        "account_ids": list(culprit.account_ids) if culprit else [],
        "confidence": str(culprit.confidence) if culprit else None,
        "why": {one: culprit_line(report, one) for one in texts.LANGUAGES},
    }


def _stack(thread: Thread) -> dict[str, Any]:
    return {
        "tid": thread.tid,
        "name": thread.name,
        "holds_gil": thread.holds_gil,
        "active": thread.active,
        "frames": [
            {"function": frame.function, "place": frame.place, "own": is_own(frame.place)}
            for frame in thread.frames[:FRAMES_MAX]
        ],
    }


def _points(report: Report) -> list[list[float]]:
    """Return the memory curve with at most POINTS_MAX points, the last one among them."""
    step = max(1, -(-len(report.memory) // POINTS_MAX))
    kept = report.memory[::-1][::step][::-1]
    return [[round(at_s, 2), held_bytes] for at_s, held_bytes in kept]
