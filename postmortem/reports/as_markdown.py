"""Prints a report as Markdown for people, in one language.

Every value that the template prints passes through one escape, so that a description typed into the ledger
can neither break out of its line nor carry a terminal's control characters into whoever shows the file.
HTML's autoescape would have been the wrong tongue: what is special to Markdown is not what is special to it.
"""

import re
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from frontend import catalogue_reports as texts
from postmortem.incident import at_work, ending
from postmortem.reports.as_terminal import milliseconds
from postmortem.reports.evidence_words import command_word, kind_word, stage_word, told
from postmortem.reports.report import (
    Report,
    finding_line,
    money_line,
    next_step,
    no_requests,
    outage_word,
    request_word,
)
from postmortem.reports.visible import visible

_TEMPLATES = Path(__file__).resolve().parents[2] / "templates"

_SPECIAL = re.compile(r"[\\`*\[\]<>|#~]|(?<![^\W_])_|_(?![^\W_])")


def as_markdown(report: Report, language: str) -> str:
    """Return the report as a Markdown document."""
    incident = report.incident
    words = {key: text[language] for key, text in texts.WORDS.items()}
    return (
        _environment()
        .get_template("report.md.j2")
        .render(
            w=words,
            incident=incident,
            contents=report.contents,
            summary=report.summary[language],
            next_step=next_step(incident, language),
            grade=texts.GRADES[incident.grade][language],
            outcome=texts.OUTCOME_WORDS[
                ending(incident.outcome, incident.closed_at, incident.served_again_at)
            ][language],
            accounts=", ".join(report.account_ids),
            transactions=", ".join(report.transaction_ids),
            fingerprint=report.fingerprint,
            money=money_line(report, language),
            steps={step: text[language] for step, text in texts.STEPS.items()},
            findings=[
                {
                    "sentence": finding_line(finding, language),
                    "grade": texts.GRADES[finding.confidence][language],
                    "evidence": [told(line, language) for line in finding.evidence],
                }
                for finding in report.findings
            ],
            evidence=[
                (kind_word(line.code, language), told(line.text, language)) for line in incident.evidence
            ],
            commands=[
                (command, command_word(command.kind, language), stage_word(command.stage, language))
                for command in at_work(incident)
            ],
            no_requests=no_requests(incident, language),
            outage=milliseconds(incident.outage_ms, outage_word(incident, language)),
            suspects=incident.suspects,
            blamed=incident.blamed,
            requests=[
                {
                    "method": request.method,
                    "path": request.path,
                    "outcome": request_word(incident, request, language),
                    "status": request.status,
                    "held_ms": request.held_ms,
                }
                for request in incident.requests
            ],
            ms=lambda value: milliseconds(value, words["nothing_recorded"]),
        )
    )


def escape(value: object) -> str:
    """Return a value as Markdown that shows exactly its characters, on one line."""
    return _SPECIAL.sub(r"\\\g<0>", visible(str(value)))


def _environment() -> Environment:
    return Environment(
        loader=FileSystemLoader(_TEMPLATES),
        undefined=StrictUndefined,
        finalize=escape,
        keep_trailing_newline=True,
        autoescape=False,  # noqa: S701  the output is Markdown; `finalize` escapes for it
    )
