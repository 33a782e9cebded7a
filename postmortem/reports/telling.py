"""What the papers of an incident say, in one language and in the order of a post-mortem; a printer only sets it.

Markdown and HTML differ in how a value is escaped and in whether there are pictures, and in nothing that is said: both
print this. It has the fields of the post-mortem that many teams write (summary, impact, root causes, trigger,
resolution, detection, action items, lessons, timeline, supporting information), filled in from facts; what only people
can know is left for them by name and never made up.
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from frontend import catalogue_prevention as prevention
from frontend import catalogue_reports as texts
from postmortem.analyzer.case import Finding, Thread
from postmortem.analyzer.fingerprint import is_own
from postmortem.incident import Incident, Trial, at_work, ending
from postmortem.reports.as_terminal import milliseconds
from postmortem.reports.drawings import Drawing, Moment, Wait, draw_memory, draw_ring, draw_timeline
from postmortem.reports.evidence_words import command_word, kind_word, ordeal_word, stage_word, told
from postmortem.reports.report import (
    Report,
    change_line,
    culprit_line,
    finding_line,
    money_line,
    next_step,
    no_requests,
    outage_word,
    proposal_text,
    repetition_line,
    request_word,
)

#: Of one list on paper; what is left out is counted.
LINES_MAX = 200
#: Outcomes of requests that went well for whoever waited, and those that did not.
_WELL = frozenset({"answered", "replayed", "committed", "done", "promised"})
_BADLY = frozenset({"not_done", "unknown", "refused"})
#: Steps at which somebody is served again: what ends with them, or before, is the outage.
_SERVED = "serving"


class Said(msgspec.Struct, frozen=True):
    """One finding on paper: its sentence, how sure it is, and its lines of evidence."""

    sentence: str
    grade: str
    evidence: tuple[str, ...]


class Stack(msgspec.Struct, frozen=True):
    """One thread on paper; a frame is its text and whether it is our own code. `holds`: it held the interpreter."""

    name: str
    holds: bool
    frames: tuple[tuple[str, bool], ...]


def telling(report: Report, language: str) -> dict[str, Any]:
    """Return the values of the paper templates. Texts are as they were said: whoever prints them escapes them."""
    incident = report.incident
    words = words_of(language)
    nothing = words["nothing_recorded"]
    return {
        "w": words,
        "lang": language,
        "incident": incident,
        "contents": report.contents,
        "title": report.title[language],
        "summary": report.summary[language],
        "next_step": next_step(incident, language),
        "grade": texts.GRADES[incident.grade][language],
        "outcome": outcome_word(incident, language),
        "accounts": ", ".join(report.account_ids),
        "transactions": ", ".join(report.transaction_ids),
        "fingerprint": report.fingerprint,
        "why": report.print_of.why,
        "money": money_line(report, language),
        "findings": [_said(finding, language) for finding in report.findings],
        "culprit": report.culprit,
        "culprit_kind": command_word(report.culprit.kind, language) if report.culprit else "",
        "culprit_grade": texts.GRADES[report.culprit.confidence][language] if report.culprit else "",
        "culprit_why": culprit_line(report, language),
        "trials": [_trial(trial, language) for trial in incident.trials[:LINES_MAX]],
        "evidence": [
            (kind_word(line.code, language), told(line.text, language)) for line in incident.evidence
        ],
        "commands": [
            (command, command_word(command.kind, language), stage_word(command.stage, language))
            for command in at_work(incident)[:LINES_MAX]
        ],
        "commands_more": max(0, len(incident.in_flight) - LINES_MAX),
        "no_requests": no_requests(incident, language),
        "outage": milliseconds(incident.outage_ms, outage_word(incident, language)),
        "suspects": incident.suspects,
        "blamed": incident.blamed,
        "requests": [
            {
                "method": request.method,
                "path": request.path,
                "outcome": request_word(incident, request, language),
                "status": request.status,
                "held_ms": request.held_ms,
            }
            for request in incident.requests[:LINES_MAX]
        ],
        "requests_more": max(0, len(incident.requests) - LINES_MAX),
        "request_counts": request_counts(report, language),
        "repetition": repetition_line(report.repetition, language),
        "changes": [change_line(change, language) for change in report.changes or ()],
        "proposals": [proposal_text(proposed, language) for proposed in report.proposals],
        "well": list(_went_well(report, words)),
        "wrong": list(_went_wrong(report, words)),
        "timeline": timeline_drawing(incident, language),
        "memory": draw_memory(report.memory, report.memory_limit_bytes, language),
        "ring": draw_ring([Wait(one.who, one.lock, one.holder) for one in report.waits], language),
        "stacks": [_stack(thread) for thread in report.threads],
        "steps": {step: text[language] for step, text in texts.STEPS.items()},
        "ms": lambda value: milliseconds(value, nothing),
    }


def words_of(language: str) -> dict[str, str]:
    """Return the small words of reports in one language."""
    return {key: text[language] for table in (texts.WORDS, prevention.WORDS) for key, text in table.items()}


def outcome_word(incident: Incident, language: str) -> str:
    """Return what came of it, in a word or two."""
    how = ending(incident.outcome, incident.closed_at, incident.served_again_at)
    return texts.OUTCOME_WORDS[how][language]


def timeline_drawing(incident: Incident, language: str) -> Drawing | None:
    """Return the drawing of an incident's timeline; the outage ends with the first answer."""
    at = {step.step: step.offset_ms for step in incident.timeline}
    served_ms = at.get(_SERVED)
    moments = [
        Moment(
            texts.STEPS[step.step][language] if step.step in texts.STEPS else step.step,
            step.offset_ms,
            outage=served_ms is not None and step.offset_ms <= served_ms,
        )
        for step in incident.timeline
        if step.offset_ms is not None
    ]
    return draw_timeline(moments, language)


def request_counts(report: Report, language: str) -> list[tuple[str, int]]:
    """Return how many requests came to which end, the most frequent first."""
    ends = Counter(request_word(report.incident, one, language) for one in report.incident.requests)
    return ends.most_common()


def _went_well(report: Report, words: Mapping[str, str]) -> Iterable[str]:
    if report.money.lost == 0:
        yield words["well_nothing_lost"]
    carried = sum(one.outcome in _WELL for one in report.incident.requests)
    if carried:
        yield words["well_replayed"].format(count=carried)
    if report.contents.complete:
        yield words["well_evidence"]


def _went_wrong(report: Report, words: Mapping[str, str]) -> Iterable[str]:
    if report.contents.missing:
        yield words["wrong_evidence"].format(count=len(report.contents.missing))
    failed = sum(one.outcome in _BADLY for one in report.incident.requests)
    if failed:
        yield words["wrong_requests"].format(count=failed)
    if report.repetition is not None and report.repetition.count:
        yield words["wrong_again"]


def _said(finding: Finding, language: str) -> Said:
    return Said(
        finding_line(finding, language),
        texts.GRADES[finding.confidence][language],
        tuple(told(line, language) for line in finding.evidence),
    )


def _trial(trial: Trial, language: str) -> tuple[str, str, str, str]:
    took = milliseconds(trial.took_ms, "-")
    return trial.command_id or trial.name, ordeal_word(trial.ordeal, language), trial.letter, took


def _stack(thread: Thread) -> Stack:
    frames = tuple((f"{frame.function} ({frame.place})", is_own(frame.place)) for frame in thread.frames)
    return Stack(thread.name or str(thread.tid or "?"), thread.holds_gil, frames)
