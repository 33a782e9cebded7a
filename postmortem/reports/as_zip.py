"""Packs an incident for somebody else: the papers and the evidence's structure, without values; and says what is missing.

What is packed is made anew through `redaction`; a file that can't be redacted (a page of bytes, a log, a recording, an
image of memory) is left out and named with its reason. The same list is the preview before an export, and stands
in the archive as `contents.txt`. Every name and time in the archive is fixed, so that the same incident makes the same
bytes. To pack the folder as it is was not chosen, although its values are masked: see `redaction`.
"""

import io
import json
import re
import zipfile
from collections.abc import Sequence
from typing import Any

import msgspec
from msgspec import structs

from frontend import catalogue_prevention as texts
from postmortem import bundle
from postmortem.analyzer.case import Finding, Frame, Thread
from postmortem.analyzer.culprit import Culprit
from postmortem.analyzer.proposals import Proposed
from postmortem.bundle import BundleFailed, Found
from postmortem.incident import Audit, Command, Incident, Request, Trial, Words
from postmortem.reports.as_html import as_html
from postmortem.reports.as_json import as_story
from postmortem.reports.as_markdown import as_markdown
from postmortem.reports.redaction import MASK, Sieve
from postmortem.reports.report import Change, Contents, Report, group_title, summarise

#: Evidence that has a structure to show; all else is left out.
STRUCTURED = (
    "incident.json",
    "memory.json",
    "process.json",
    "recorder.json",
    "stacks.json",
    "stacks-first.json",
    "locks.json",
    "tasks.json",
)
#: Files of a bundle that may be called by their names; another name is somebody's text.
_NAMES = frozenset(
    (
        *STRUCTURED,
        "opening.json",
        "recorder.bin",
        "log.txt",
        "stacks.txt",
        "observations.jsonl",
        "manifest.json",
    )
)
_PREFIX = re.compile(r"life-\d{1,3}\.")
#: Of one file before it is redacted.
FILE_BYTES_MAX = 8 << 20
CONTENTS = "contents.txt"
_EPOCH = (1980, 1, 1, 0, 0, 0)
_OWNER_ONLY = 0o600 << 16


class Packed(msgspec.Struct, frozen=True):
    """An archive's files by name, and one line for each thing that was left out or hidden."""

    files: tuple[tuple[str, bytes], ...]
    lines: tuple[str, ...]


def pack(found: Found, report: Report, language: str) -> Packed:
    """Return what an export of this incident holds. It is the preview too: nothing is written."""
    files: list[tuple[str, bytes]] = []
    lines: list[str] = []
    sieve = Sieve()
    clean = redacted(report, sieve)
    story = json.dumps(as_story(clean, language), ensure_ascii=False, indent=1) + "\n"
    for name, text in (
        ("report.md", as_markdown(clean, language)),
        ("report.html", as_html(clean, language)),
        ("report.json", story),
    ):
        files.append((name, text.encode("utf-8", "backslashreplace")))
    lines.append(_line("masked", language, name="report", count=str(sieve.hidden)))
    for name in sorted(report.contents.files):
        told = _structure(found, name, language)
        if isinstance(told, str):
            lines.append(_line("left_out", language, name=_file_name(name), why=told))
            continue
        data, hidden = told
        files.append((f"evidence/{name}", data))
        lines.append(_line("masked", language, name=name, count=str(hidden)))
    files.append((CONTENTS, ("\n".join(lines) + "\n").encode()))
    return Packed(tuple(files), tuple(lines))


def as_zip(files: Sequence[tuple[str, bytes]]) -> bytes:
    """Return the files as an archive; the same files make the same bytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files:
            entry = zipfile.ZipInfo(name, _EPOCH)
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, _OWNER_ONLY
            archive.writestr(entry, data)
    return buffer.getvalue()


def redacted(report: Report, sieve: Sieve) -> Report:
    """Return a report in which every text that came from evidence has gone through the sieve."""
    incident = _incident(report.incident, sieve)
    made = structs.replace(report.print_of, why=tuple(map(sieve.sentence, report.print_of.why)))
    return structs.replace(
        report,
        incident=incident,
        summary={language: summarise(incident, language) for language in report.summary},
        title={language: group_title(incident, made, language) for language in report.title},
        findings=tuple(_finding(finding, sieve) for finding in report.findings),
        account_ids=tuple(map(sieve.identifier, report.account_ids)),
        transaction_ids=tuple(map(sieve.identifier, report.transaction_ids)),
        command_ids=tuple(map(sieve.identifier, report.command_ids)),
        contents=_contents(report.contents, sieve),
        print_of=made,
        changes=None if report.changes is None else tuple(_change(one, sieve) for one in report.changes),
        culprit=_culprit(report.culprit, sieve),
        proposals=tuple(_proposal(proposed, sieve) for proposed in report.proposals),
        threads=tuple(_thread(thread, sieve) for thread in report.threads),
        waits=tuple(
            structs.replace(
                wait,
                who=sieve.named(wait.who, "thread_name"),
                lock=sieve.named(wait.lock, "kind"),
                holder=sieve.named(wait.holder, "thread_name"),
            )
            for wait in report.waits
        ),
    )


def _incident(one: Incident, sieve: Sieve) -> Incident:
    return structs.replace(
        one,
        diagnosis=sieve.named(one.diagnosis, "diagnosis"),
        waits_for=sieve.named(one.waits_for, "diagnosis") if one.waits_for else one.waits_for,
        reason=sieve.sentence(one.reason) if one.reason else one.reason,
        drill=sieve.named(one.drill, "kind") if one.drill else one.drill,
        evidence=tuple(_words(words, sieve) for words in one.evidence),
        last_words=_words(one.last_words, sieve) if one.last_words else None,
        timeline=tuple(structs.replace(step, step=sieve.named(step.step, "step")) for step in one.timeline),
        in_flight=tuple(_command(command, sieve) for command in one.in_flight),
        suspects=tuple(map(sieve.identifier, one.suspects)),
        blamed=tuple(map(sieve.identifier, one.blamed)),
        requests=tuple(_request(request, sieve) for request in one.requests),
        audit=_audit(one.audit, sieve) if one.audit else None,
        deaths=tuple(
            structs.replace(death, diagnosis=sieve.named(death.diagnosis, "diagnosis"))
            for death in one.deaths
        ),
        trials=tuple(_trial(trial, sieve) for trial in one.trials),
        left_open=sieve.identifier(one.left_open) if one.left_open else one.left_open,
        proof=structs.replace(one.proof, kind=sieve.named(one.proof.kind, "kind")) if one.proof else None,
        versions=structs.replace(
            one.versions,
            build=sieve.identifier(one.versions.build) if one.versions.build else None,
            policy=sieve.identifier(one.versions.policy) if one.versions.policy else None,
        ),
    )


def _words(words: Words, sieve: Sieve) -> Words:
    return Words(sieve.sentence(words.code), sieve.sentence(words.text))


def _audit(audit: Audit, sieve: Sieve) -> Audit:
    return structs.replace(audit, fault=sieve.sentence(audit.fault))


def _command(command: Command, sieve: Sieve) -> Command:
    return structs.replace(
        command,
        command_id=sieve.identifier(command.command_id),
        kind=sieve.named(command.kind, "kind"),
        stage=sieve.named(command.stage, "stage"),
        transaction_id=sieve.identifier(command.transaction_id),
        account_ids=tuple(map(sieve.identifier, command.account_ids)),
        key_hash=sieve.identifier(command.key_hash),
    )


def _request(request: Request, sieve: Sieve) -> Request:
    return structs.replace(
        request,
        method=sieve.named(request.method, "method"),
        path=sieve.path(request.path),
        key_hash=sieve.identifier(request.key_hash),
        outcome=sieve.named(request.outcome, "outcome"),
    )


def _trial(trial: Trial, sieve: Sieve) -> Trial:
    return structs.replace(
        trial,
        name=sieve.identifier(trial.name),
        command_id=sieve.identifier(trial.command_id),
        ordeal=sieve.named(trial.ordeal, "ordeal"),
        letter=sieve.identifier(trial.letter),
        why=sieve.sentence(trial.why),
        fingerprint=sieve.identifier(trial.fingerprint),
        kind=sieve.named(trial.kind, "kind"),
        account_ids=tuple(map(sieve.identifier, trial.account_ids)),
        transaction_id=sieve.identifier(trial.transaction_id),
    )


def _finding(finding: Finding, sieve: Sieve) -> Finding:
    return structs.replace(
        finding,
        values={name: sieve.named(value, name) for name, value in finding.values.items()},
        evidence=tuple(map(sieve.sentence, finding.evidence)),
        account_ids=tuple(map(sieve.identifier, finding.account_ids)),
        transaction_ids=tuple(map(sieve.identifier, finding.transaction_ids)),
        waits=(),
    )


def _culprit(culprit: Culprit | None, sieve: Sieve) -> Culprit | None:
    if culprit is None:
        return None
    return structs.replace(
        culprit,
        command_id=sieve.identifier(culprit.command_id),
        kind=sieve.named(culprit.kind, "kind"),
        transaction_id=sieve.identifier(culprit.transaction_id),
        account_ids=tuple(map(sieve.identifier, culprit.account_ids)),
    )


def _change(change: Change, sieve: Sieve) -> Change:
    before, now = (sieve.named(one, "digest") if one else None for one in (change.before, change.now))
    return structs.replace(change, before=before, now=now)


def _proposal(proposed: Proposed, sieve: Sieve) -> Proposed:
    rule = {name: sieve.value(one, name) for name, one in proposed.rule.items()} if proposed.rule else None
    values = {name: sieve.sentence(value) for name, value in proposed.values.items()}
    return structs.replace(proposed, values=values, rule=rule)


def _thread(thread: Thread, sieve: Sieve) -> Thread:
    frames = tuple(
        Frame(sieve.named(frame.function, "function"), sieve.named(frame.place, "place"), {})
        for frame in thread.frames
    )
    return structs.replace(thread, name=sieve.named(thread.name, "thread_name"), frames=frames)


def _contents(contents: Contents, sieve: Sieve) -> Contents:
    return structs.replace(
        contents,
        files={_file_name(name): size for name, size in contents.files.items()},
        missing={_file_name(name): sieve.sentence(why) for name, why in contents.missing.items()},
        faults=tuple(map(sieve.sentence, contents.faults)),
    )


def _structure(found: Found, name: str, language: str) -> tuple[bytes, int] | str:
    """Return a file of the evidence without its values and how many those were, or why it is left out."""
    if bundle.is_image(name):
        return texts.EXPORT["image"][language]
    if _PREFIX.sub("", name, count=1) not in STRUCTURED:
        return texts.EXPORT["not_a_report"][language]
    data = bundle.read_file(found.path, name, FILE_BYTES_MAX)
    if isinstance(data, BundleFailed):
        return texts.EXPORT["unreadable"][language]
    try:
        raw: Any = json.loads(data)
    except (ValueError, RecursionError):
        return texts.EXPORT["unreadable"][language]
    sieve = Sieve()
    told = json.dumps(sieve.value(raw), ensure_ascii=False, indent=1) + "\n"
    return told.encode("utf-8", "backslashreplace"), sieve.hidden


def _file_name(name: str) -> str:
    known = _PREFIX.sub("", name, count=1) in _NAMES or bundle.is_image(name)
    return name if known else MASK


def _line(key: str, language: str, **values: str) -> str:
    return texts.EXPORT[key][language].format_map(values)
