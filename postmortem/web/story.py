"""One incident as its page shows it: the report's facts in one language, with the drawings and the stacks beside them.

The report is made from the folder each time it is looked at, by the same code as every other form of it; a copy in
the archive could tell another story after an update. What else the folder holds is read here, of whatever it holds:
nothing in it is trusted, everything has a largest number, and what is missing is shown as missing.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from frontend import catalogue_reports
from postmortem import bundle, reading
from postmortem.analyzer.case import Frame, Thread
from postmortem.analyzer.fingerprint import is_own
from postmortem.bundle import BundleFailed, Found
from postmortem.incident import Command, at_work, mapping, mappings, number, text
from postmortem.reports import drawings
from postmortem.reports.drawings import Drawing, Moment, Wait
from postmortem.reports.evidence_words import command_word, kind_word, stage_word, told
from postmortem.reports.report import (
    Report,
    culprit_line,
    finding_line,
    money_line,
    next_step,
    no_requests,
    outage_word,
    request_word,
)

CRUMBS_MAX: Final = 50
THREADS_SHOWN_MAX: Final = 64
REQUESTS_SHOWN_MAX: Final = 200
TYPES_SHOWN_MAX: Final = 10
VEILED_MAX: Final = 200
#: Of an account or a transaction so much is shown before somebody asks to see it.
MASKED_CHARACTERS: Final = 4


class Stack(msgspec.Struct, frozen=True):
    """A thread's stack: `own` frames from the inside out, and the others, which are folded."""

    name: str
    active: bool
    holds_gil: bool
    own: tuple[Frame, ...]
    system: tuple[Frame, ...]


class Story(msgspec.Struct, frozen=True):
    """What the page of an incident shows besides the archive's own facts."""

    report: Report
    stacks: tuple[Stack, ...]
    crumbs: tuple[Mapping[str, Any], ...]
    types: tuple[tuple[str, int, int], ...]
    changes: tuple[str, ...]
    timeline: Drawing | None
    memory: Drawing | None
    ring: Drawing | None


def find(incidents: Path, incident_id: str) -> Found | None:
    """Return the folder of an incident, whole or partial; None where there is none, or the id is no id."""
    if not bundle.is_incident_id(incident_id):
        return None
    for name, partial in ((incident_id, False), (f".{incident_id}.partial", True)):
        path = incidents / name
        if path.is_dir() and not path.is_symlink():
            return Found(incident_id, path, partial)
    return None


def tell(found: Found, lang: str) -> Story:
    """Return the story of one folder, of whatever it holds."""
    report = reading.read_report(found)
    recorder = mapping(_json(found, "recorder.json"))
    memory = mapping(_json(found, "memory.json"))
    return Story(
        report=report,
        stacks=stacks_of(report.threads),
        crumbs=tuple(mappings(recorder.get("finished"))[-CRUMBS_MAX:]),
        types=_types(memory),
        changes=_changes(_json(found, "report.json"), lang),
        timeline=_timeline(report, lang),
        memory=drawings.draw_memory(report.memory, report.memory_limit_bytes, lang),
        ring=_ring(report, lang),
    )


def stacks_of(threads: Sequence[Thread]) -> tuple[Stack, ...]:
    """Return the stacks, those with frames of ours first, and of each the own frames apart from the system's."""
    found = []
    for thread in threads[:THREADS_SHOWN_MAX]:
        own = tuple(frame for frame in thread.frames if is_own(frame.place))
        system = tuple(frame for frame in thread.frames if not is_own(frame.place))
        name = thread.name or str(thread.tid or "?")
        found.append(Stack(name, thread.active, thread.holds_gil, own, system))
    return tuple(sorted(found, key=lambda one: (not one.holds_gil, not one.active, -len(one.own))))


def causes(report: Report, lang: str, *, shown: bool) -> list[Mapping[str, Any]]:
    """Return each finding as a sentence with its confidence and what it stands on."""
    return [
        {
            "said": veiled(report, finding_line(finding, lang), shown=shown),
            "confidence": str(finding.confidence),
            "evidence": [veiled(report, told(line, lang), shown=shown) for line in finding.evidence],
        }
        for finding in report.findings
    ]


def evidence(report: Report, lang: str, *, shown: bool) -> list[tuple[str, str]]:
    """Return what each witness said: who, what."""
    return [
        (kind_word(one.code, lang), veiled(report, told(one.text, lang), shown=shown))
        for one in report.incident.evidence
    ]


def commands(report: Report, lang: str, *, shown: bool) -> list[Mapping[str, Any]]:
    """Return the commands in flight, those at work first; ids are masked unless `shown`."""
    blamed = set(report.incident.blamed)
    return [
        {
            "kind": command_word(one.kind, lang),
            "stage": stage_word(one.stage, lang),
            "age_ms": one.age_ms,
            "accounts": [masked(account, shown=shown) for account in one.account_ids],
            "transaction": masked(one.transaction_id, shown=shown),
            "command": masked(one.command_id, shown=shown),
            "blamed": one.command_id in blamed or _is_suspect(one, report),
        }
        for one in at_work(report.incident)[:CRUMBS_MAX]
    ]


def named(report: Report, *, shown: bool) -> Mapping[str, list[str]]:
    """Return the accounts and transactions that the report names, masked unless `shown`."""
    return {
        "accounts": [masked(one, shown=shown) for one in report.account_ids],
        "transactions": [masked(one, shown=shown) for one in report.transaction_ids],
    }


def masked(identity: str, *, shown: bool) -> str:
    """Return an id with its middle hidden: its kind and its end stay, so that two of them can be told apart."""
    if shown or not identity:
        return identity
    kind, colon, rest = identity.partition(":")
    lead, rest = (f"{kind}:", rest) if colon else ("", identity)
    return f"{lead}…{rest[-MASKED_CHARACTERS:]}" if len(rest) > MASKED_CHARACTERS else f"{lead}…"


def veiled(report: Report, said: str, *, shown: bool) -> str:
    """Return a sentence with the ids in it masked, unless `shown`: those that the report names."""
    if shown:
        return said
    for one in (*report.account_ids, *report.transaction_ids, *report.command_ids)[:VEILED_MAX]:
        if len(one) > MASKED_CHARACTERS:
            said = said.replace(one, masked(one, shown=False))
    return said


def crumb(line: Mapping[str, Any], lang: str, *, shown: bool) -> Mapping[str, Any]:
    """Return a finished command as the page shows it."""
    accounts = line.get("account_ids")
    return {
        "kind": command_word(text(line.get("kind")), lang),
        "accounts": [masked(text(one), shown=shown) for one in accounts[:8]]
        if isinstance(accounts, list)
        else [],
        "outcome": str(number(line.get("outcome")) or "–"),
        "age_ms": number(line.get("age_ms")),
    }


def requests(report: Report, lang: str, *, shown: bool) -> list[Mapping[str, Any]]:
    """Return what became of each request that met the outage."""
    return [
        {
            "request": veiled(report, f"{one.method} {one.path}", shown=shown),
            "outcome": request_word(report.incident, one, lang),
            "status": one.status,
            "held_ms": one.held_ms,
        }
        for one in report.incident.requests[:REQUESTS_SHOWN_MAX]
    ]


def sentences(report: Report, lang: str) -> Mapping[str, str | None]:
    """Return the sentences of the page's head."""
    return {
        "summary": report.summary[lang],
        "money": money_line(report, lang),
        "outage": outage_word(report.incident, lang),
        "no_requests": no_requests(report.incident, lang),
        "next": next_step(report.incident, lang),
        "culprit": culprit_line(report, lang),
        "grade": catalogue_reports.GRADES[report.incident.grade][lang],
    }


def steps(report: Report, lang: str) -> list[tuple[str, str | None, float | None]]:
    """Return the steps of the timeline in words: what, when, ms after the fault."""
    return [(_step_word(one.step, lang), one.at, one.offset_ms) for one in report.incident.timeline]


def _is_suspect(one: Command, report: Report) -> bool:
    return bool(one.key_hash) and one.key_hash in report.incident.suspects


def _step_word(step: str, lang: str) -> str:
    known = catalogue_reports.STEPS.get(step)
    return step if known is None else known[lang]


def _timeline(report: Report, lang: str) -> Drawing | None:
    known = [one for one in report.incident.timeline if one.offset_ms is not None]
    back_ms = next((one.offset_ms for one in known if one.step == "serving"), None)
    moments = [
        Moment(
            _step_word(one.step, lang),
            one.offset_ms or 0.0,
            outage=back_ms is None or (one.offset_ms or 0.0) <= back_ms,
        )
        for one in known
    ]
    return drawings.draw_timeline(moments, lang)


def _ring(report: Report, lang: str) -> Drawing | None:
    return drawings.draw_ring([Wait(one.who, one.lock, one.holder) for one in report.waits], lang)


def _types(memory: Mapping[str, Any]) -> tuple[tuple[str, int, int], ...]:
    """Return what grew most between the last two censuses: type, objects, bytes."""
    grown = mappings(mapping(memory.get("growth")).get("types"))[:TYPES_SHOWN_MAX]
    return tuple(
        (text(one.get("name")), number(one.get("count")) or 0, number(one.get("size_bytes")) or 0)
        for one in grown
    )


def _changes(kept: object, lang: str) -> tuple[str, ...]:
    """Return what changed since the start before, as the report said when it was made: before it, all is settled."""
    lines = (text(mapping(one.get("text")).get(lang)) for one in mappings(mapping(kept).get("changes")))
    return tuple(line for line in lines if line)


def _json(found: Found, name: str) -> object:
    data = bundle.read_file(found.path, name)
    if isinstance(data, BundleFailed):
        return None
    try:
        parsed: object = json.loads(data)
    except (ValueError, RecursionError):
        return None
    return parsed
