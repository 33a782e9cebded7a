"""Prints a report as the JSON that programs rely on: an item of the list, and the whole story."""

from dataclasses import asdict
from typing import Any

from frontend import catalogue_reports as texts
from postmortem.incident import at_work
from postmortem.reports.report import Report, finding_line, next_step, no_requests, outage_word, request_word


def as_item(report: Report, language: str) -> dict[str, Any]:
    """Return the report as one item of the list of incidents."""
    incident = report.incident
    return {
        "id": incident.id,
        "opened_at": incident.opened_at,
        "closed_at": incident.closed_at,
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
        "fingerprint": report.fingerprint,
        "evidence_complete": report.contents.complete,
        "money": asdict(report.money),
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
        "timeline": [asdict(step) for step in incident.timeline],
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
        "proposals": [],
        "requests": [
            asdict(request) | {"told": {one: request_word(incident, request, one) for one in texts.LANGUAGES}}
            for request in incident.requests
        ],
        "no_requests": {one: no_requests(incident, one) for one in texts.LANGUAGES},
        "no_outage": {one: outage_word(incident, one) for one in texts.LANGUAGES},
        "in_flight": [asdict(command) for command in at_work(incident)],
        "suspects": list(incident.suspects),
        "blamed": list(incident.blamed),
        "core": {
            "pid": incident.pid,
            "epoch": incident.epoch,
            "next_epoch": incident.next_epoch,
            "exit": asdict(incident.exit),
            "last_words": asdict(incident.last_words) if incident.last_words else None,
        },
        "deaths": [asdict(death) for death in incident.deaths],
        "proof": asdict(incident.proof) if incident.proof else None,
        "audit": asdict(incident.audit) if incident.audit else None,
        "bundle": asdict(report.contents) | {"faults": list(report.contents.faults)},
    }
