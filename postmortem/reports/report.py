"""The one Report value that every printer prints.

Whatever is said about an incident is decided here, once: which accounts and transactions it touched and
why, the summary in both languages, the verdict on the money. A printer chooses an order and a form, never a
fact.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from frontend import catalogue_reports as texts
from postmortem.analyzer import registry
from postmortem.analyzer.case import Case, Finding
from postmortem.incident import (
    Incident,
    Money,
    Request,
    at_work,
    ending,
    money,
    unique,
    waits_for,
    was_committed,
    went_on,
)

LANGUAGES = texts.LANGUAGES
MS_PER_S = 1000


@dataclass(frozen=True, slots=True)
class Contents:
    """The bundle behind a report: its files with their sizes, and what is wrong with it."""

    complete: bool
    partial: bool
    files: Mapping[str, int]
    missing: Mapping[str, str]
    faults: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Report:
    """Everything that is said about one incident. `summary` has one sentence for each language."""

    incident: Incident
    summary: Mapping[str, str]
    findings: tuple[Finding, ...]
    fingerprint: str
    account_ids: tuple[str, ...]
    transaction_ids: tuple[str, ...]
    command_ids: tuple[str, ...]
    money: Money
    contents: Contents


def make_report(case: Case, contents: Contents) -> Report:
    """Return the report of a case: the same one whenever it is asked for."""
    incident, findings = case.incident, registry.examine(case)
    commands = at_work(incident)
    in_stacks = [one for finding in findings for one in finding.account_ids]
    in_slots = [one for command in commands for one in command.account_ids]
    transactions = [one for finding in findings for one in finding.transaction_ids]
    return Report(
        incident=incident,
        summary={language: summarise(incident, language) for language in LANGUAGES},
        findings=findings,
        fingerprint=registry.fingerprint(case, findings),
        account_ids=unique([*in_stacks, *in_slots]),
        transaction_ids=unique([*transactions, *(command.transaction_id for command in commands)]),
        command_ids=unique(command.command_id for command in commands),
        money=money(incident),
        contents=contents,
    )


def summarise(incident: Incident, language: str) -> str:
    """Return what happened as one plain sentence."""
    cause = texts.CAUSES.get(incident.diagnosis, texts.CAUSES["UNKNOWN"])[language]
    lead = texts.GRADE_LEADS[incident.grade if incident.diagnosis in texts.CAUSES else "certain"][language]
    timed = incident.outcome == "recovered" and incident.outage_ms is not None
    how = ending(incident.outcome, incident.closed_at, incident.served_again_at)
    if incident.outcome == "recovered" and went_on(incident):
        how = "went_on"
    if incident.outcome == "recovered" and incident.left_open is not None and not timed:
        how = "left_open"
    if how == "taken_over" and incident.outage_ms is not None:
        how = "taken_over_in"
    outcome = texts.OUTCOMES["recovered_in" if timed else how][language]
    after = _after(incident.outage_ms or 0, language)
    joint = " " if language == "ko" else "; "
    sentence = f"{lead}{cause}{joint}{outcome.format(after=after, incident=incident.left_open)}"
    waits = waits_for(incident)
    if incident.outcome == "safe_mode" and incident.waits_for != incident.diagnosis:
        waits = incident.waits_for  # what began it is not what keeps it from writing
    if waits is not None and waits in texts.WAITS:
        reason = texts.WAITS[waits][language]
        sentence = f"{sentence.removesuffix('.')}: {waits} — {reason}"
    return sentence[0].upper() + sentence[1:]


def _after(outage_ms: float, language: str) -> str:
    """Return how long an outage took: where it was short, a tenth of a second says nothing."""
    if outage_ms < MS_PER_S:
        return f"{outage_ms:.0f} ms"
    return f"{outage_ms / MS_PER_S:.1f}{'초' if language == 'ko' else ' s'}"


def money_line(report: Report, language: str) -> str:
    """Return the verdict on the money as a sentence that claims no more than the recorded proof."""
    audit = report.incident.audit
    if audit is None:
        return _proven_line(report, language)
    if not audit.ok:
        return texts.MONEY["unsound"][language].format(fault=audit.fault)
    whole = texts.MONEY["whole"][language].format(seq=audit.seq if audit.seq is not None else "?")
    return f"{_proven_line(report, language)} {whole}"


def _proven_line(report: Report, language: str) -> str:
    proof, verdict = report.incident.proof, report.money
    if proof is None or not verdict.verified:
        return texts.MONEY[_unproven(report.incident)][language]
    if verdict.lost == 0:
        return texts.MONEY["witness"][language].format(witness_seq=proof.witness_seq)
    if proof.seq == 0:
        return texts.MONEY["empty"][language]
    return texts.MONEY["chain"][language].format(tail=proof.tail if proof.tail is not None else "?")


def _unproven(incident: Incident) -> str:
    if went_on(incident):
        return "went_on"
    return "none" if incident.closed_at is None else "no_proof"


def outage_word(incident: Incident, language: str) -> str:
    """Return what stands in the place of an outage's length where none was measured."""
    if not went_on(incident):
        return texts.WORDS["nothing_recorded"][language]
    return texts.WORDS["reads_went_on" if incident.outcome == "safe_mode" else "nothing_stopped"][language]


def no_requests(incident: Incident, language: str) -> str:
    """Return what is said where no request is on record."""
    return texts.WORDS["refusals_untold" if went_on(incident) else "no_requests"][language]


def request_word(incident: Incident, request: Request, language: str) -> str:
    """Return what became of a request, in words; an outcome unknown here as it is."""
    outcome = "committed" if was_committed(incident, request) else request.outcome
    known = texts.REQUEST_OUTCOMES.get(outcome)
    return outcome if known is None else known[language]


def next_step(incident: Incident, language: str) -> str | None:
    """Return what a person is to do now. None: nothing, or nothing that is known here."""
    waits = waits_for(incident)
    if waits is None:
        return None
    return texts.NEXT_STEPS.get(waits, texts.NEXT_STEPS["UNKNOWN"])[language]


def finding_line(finding: Finding, language: str) -> str:
    """Return a finding as a sentence."""
    return texts.FINDINGS[finding.rule][language].format_map(finding.values)


def refusal(kind: str, language: str, **values: object) -> str:
    """Return why something asked about incidents can't be done, with the next step."""
    return texts.ERRORS[kind][language].format(**values)
