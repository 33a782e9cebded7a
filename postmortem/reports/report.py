"""The one Report value that every printer prints.

Whatever is said about an incident is decided here, once: which accounts and transactions it touched and
why, the summary in both languages, the verdict on the money. A printer chooses an order and a form, never a
fact.
"""

from collections.abc import Mapping, Sequence

import msgspec

from frontend import catalogue_prevention as prevention
from frontend import catalogue_reports as texts
from frontend.catalogue_findings import FINDINGS
from postmortem.analyzer import registry
from postmortem.analyzer.case import Case, Finding, Thread, Waiting
from postmortem.analyzer.crashed import printed_threads
from postmortem.analyzer.culprit import Culprit, name_culprit
from postmortem.analyzer.fingerprint import Fingerprint, make_fingerprint
from postmortem.analyzer.proposals import FORESTALLED, Proposed, proposals
from postmortem.analyzer.tape import curve
from postmortem.incident import (
    Incident,
    Money,
    Request,
    Versions,
    at_work,
    ending,
    money,
    unique,
    waits_for,
    was_committed,
    went_on,
)
from postmortem.reports.evidence_words import command_word

LANGUAGES = texts.LANGUAGES
MS_PER_S = 1000


class Contents(msgspec.Struct, frozen=True):
    """The bundle behind a report: its files with their sizes, and what is wrong with it."""

    complete: bool
    partial: bool
    files: Mapping[str, int]
    missing: Mapping[str, str]
    faults: tuple[str, ...]


class Past(msgspec.Struct, frozen=True):
    """An earlier incident, as far as repetition and change are told from it."""

    id: str
    opened_at: str
    fingerprint: str
    versions: Versions


class Repetition(msgspec.Struct, frozen=True):
    """How often the same fingerprint was there before. `last`: the one before this, empty: there was none."""

    count: int
    last: str


class Change(msgspec.Struct, frozen=True):
    """What ran in this incident and in the one before. `what`: build, policy or schema; None: not on record."""

    what: str
    before: str | None
    now: str | None


class Report(msgspec.Struct, frozen=True):
    """Everything that is said about one incident. `summary` has one sentence for each language.

    `repetition` and `changes` None: nobody has looked at the incidents before it. `memory`: (seconds before the last
    look, bytes) of the core that was lost.
    """

    incident: Incident
    summary: Mapping[str, str]
    findings: tuple[Finding, ...]
    fingerprint: str
    account_ids: tuple[str, ...]
    transaction_ids: tuple[str, ...]
    command_ids: tuple[str, ...]
    money: Money
    contents: Contents
    print_of: Fingerprint
    title: Mapping[str, str]
    culprit: Culprit | None
    proposals: tuple[Proposed, ...]
    threads: tuple[Thread, ...] = ()
    waits: tuple[Waiting, ...] = ()
    memory: tuple[tuple[float, int], ...] = ()
    memory_limit_bytes: int | None = None
    repetition: Repetition | None = None
    changes: tuple[Change, ...] | None = None


def make_report(case: Case, contents: Contents, past: Sequence[Past] | None = None) -> Report:
    """Return the report of a case: the same one whenever it is asked for with the same past."""
    incident, findings = case.incident, registry.examine(case)
    culprit = name_culprit(case, findings)
    commands = at_work(incident)
    first_accounts = culprit.account_ids if culprit else ()
    in_stacks = [one for finding in findings for one in finding.account_ids]
    in_slots = [one for command in commands for one in command.account_ids]
    first_transactions = [culprit.transaction_id] if culprit else []
    transactions = [one for finding in findings for one in finding.transaction_ids]
    made = make_fingerprint(case, findings)
    earlier = None if past is None else earlier_than(incident, past)
    return Report(
        incident=incident,
        summary={language: summarise(incident, language) for language in LANGUAGES},
        findings=findings,
        fingerprint=made.digest,
        account_ids=unique([*first_accounts, *in_stacks, *in_slots]),
        transaction_ids=unique(
            [*first_transactions, *transactions, *(command.transaction_id for command in commands)]
        ),
        command_ids=unique(
            [culprit.command_id if culprit else "", *(command.command_id for command in commands)]
        ),
        money=money(incident),
        contents=contents,
        print_of=made,
        title={language: group_title(incident, made, language) for language in LANGUAGES},
        culprit=culprit,
        proposals=proposals(case, findings),
        threads=case.threads or printed_threads(case.traceback),
        waits=next((finding.waits for finding in findings if finding.waits), ()),
        memory=case.tape.course if incident.diagnosis in FORESTALLED else curve(case.tape, incident.pid),
        memory_limit_bytes=case.tape.memory_limit_bytes,
        repetition=None if earlier is None else _repetition(made.digest, earlier),
        changes=None if earlier is None else _changes(incident.versions, earlier),
    )


def earlier_than(incident: Incident, past: Sequence[Past]) -> list[Past]:
    """Return the incidents that were opened before this one, newest first."""
    before = [
        one
        for one in past
        if one.id != incident.id and (one.opened_at, one.id) < (incident.opened_at or "", incident.id)
    ]
    return sorted(before, key=lambda one: (one.opened_at, one.id), reverse=True)


def _repetition(digest: str, earlier: Sequence[Past]) -> Repetition:
    equal = [one.id for one in earlier if one.fingerprint == digest]
    return Repetition(len(equal), equal[0] if equal else "")


def _changes(now: Versions, earlier: Sequence[Past]) -> tuple[Change, ...]:
    """Compare with the newest earlier incident that knows the same thing."""
    if not earlier:
        return ()
    told = {
        "build": (now.build, next((one.versions.build for one in earlier if one.versions.build), None)),
        "policy": (now.policy, next((one.versions.policy for one in earlier if one.versions.policy), None)),
        "schema": (
            _number_text(now.schema),
            next(
                (_number_text(one.versions.schema) for one in earlier if one.versions.schema is not None),
                None,
            ),
        ),
    }
    # Of what is on record on neither side a line would say nothing.
    return tuple(Change(what, before, after) for what, (after, before) in told.items() if before or after)


def _number_text(value: int | None) -> str | None:
    return None if value is None else str(value)


def group_title(incident: Incident, made: Fingerprint, language: str) -> str:
    """Return what equal deaths are called: what happened, and where if that is known."""
    what = cause_sentence(incident.diagnosis, language)
    facts = [one.partition(" ") for one in made.why]
    frame = next((rest for kind, _, rest in facts if kind == "frame"), "")
    other = next((rest for kind, _, rest in facts if kind in {"lock", "holder", "command", "component"}), "")
    form = "in" if frame else "with" if other else "plain"
    return prevention.TITLES[form][language].format(what=what, place=frame or other)


def cause_sentence(diagnosis: str, language: str) -> str:
    """Return what happened as a sentence of its own, without its full stop: the Korean half of one leads on ("…고")."""
    cause = texts.CAUSES.get(diagnosis, texts.CAUSES["UNKNOWN"])[language]
    return f"{cause.removesuffix('고')}어요" if language == "ko" else cause[0].upper() + cause[1:]


def change_line(change: Change, language: str) -> str:
    """Return what became of one thing since the start before, as a line."""
    what = prevention.WHAT[change.what][language]
    if change.before is None or change.now is None:
        return prevention.CHANGES["unknown"][language].format(what=what)
    if change.before == change.now:
        return prevention.CHANGES["same"][language].format(what=what)
    return prevention.CHANGES[change.what][language].format(before=change.before[:12], after=change.now[:12])


def repetition_line(repetition: Repetition | None, language: str) -> str:
    """Return how often it was there before, as a sentence."""
    if repetition is None:
        return texts.WORDS["nothing_recorded"][language]
    if not repetition.count:
        return prevention.WORDS["first_time"][language]
    return prevention.WORDS["seen_before"][language].format(count=repetition.count, last=repetition.last)


def culprit_line(report: Report, language: str) -> str:
    """Return why a command is named, or that none is."""
    return prevention.CULPRITS[report.culprit.why if report.culprit else "nobody"][language]


def proposal_text(proposed: Proposed, language: str) -> str:
    """Return a proposal as a sentence."""
    return prevention.PROPOSALS[proposed.says][language].format_map(proposed.values)


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
    outcome = outcome.format(after=after, incident=incident.left_open)
    joint = " " if language == "ko" else "; "
    convicted = _convicted_line(incident, language)
    first = f"{lead}{cause}{joint}" if convicted is None else f"{convicted} "
    sentence = first + (outcome if convicted is None else outcome[0].upper() + outcome[1:])
    waits = waits_for(incident)
    if incident.outcome == "safe_mode" and incident.waits_for != incident.diagnosis:
        waits = incident.waits_for  # what began it is not what keeps it from writing
    if waits is not None and waits in texts.WAITS:
        reason = texts.WAITS[waits][language]
        sentence = f"{sentence.removesuffix('.')}: {waits} — {reason}"
    return sentence[0].upper() + sentence[1:]


def _convicted_line(incident: Incident, language: str) -> str | None:
    """Return which request it was, where a trial has shown it and it is set aside: what a reader wants to know first."""
    ordeals = [trial.ordeal for trial in incident.trials if trial.reproduced and trial.letter]
    if not ordeals:
        return None
    says = ordeals[0] if len(ordeals) == 1 else "many"
    return texts.CONVICTED[says][language].format(count=len(ordeals))


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
    if audit.seq == 0:
        return _proven_line(report, language)  # of no record there is no first and no last
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
    values = dict(finding.values)
    if "kind" in values:
        values["kind"] = command_word(values["kind"], language)
    return FINDINGS[finding.rule][language].format_map(values)


def refusal(kind: str, language: str, **values: object) -> str:
    """Return why something asked about incidents can't be done, with the next step."""
    return texts.ERRORS[kind][language].format(**values)
