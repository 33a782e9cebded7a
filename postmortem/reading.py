"""Reads an incident's folder into its report, whatever state the folder is in.

An incident that is still open has only what was known when it was opened, one whose guard died may have half a
bundle, and a folder may hold anything: each gives a report that says how much is known. Only the list of folders decides which
incidents exist.
"""

import json
import re
from collections.abc import Sequence
from pathlib import Path

from msgspec import structs

from postmortem import bundle, incident
from postmortem.analyzer.case import Case, read_threads
from postmortem.analyzer.tape import read_tape
from postmortem.bundle import BundleFailed, Found, Manifest
from postmortem.reports.report import Contents, Past, Report, make_report

#: Incidents that are read for a list; older ones are found by their id.
LISTED_MAX = 1_000

#: The files that are made of all the others, and can be made again.
REPORTS = ("report.json", bundle.REPORT)

_FACTS = "incident.json"
#: Earlier incidents that are looked at for repetition, and of each the beginning of its report.
PAST_MAX = 5_000
_PAST_BYTES_MAX = 16 << 10
#: A field on the first level of a report: one to a line, and no text can hold a line's end unescaped.
_FIELD = re.compile(
    r'^ "(opened_at|fingerprint|build|policy_sha256|schema)": ("(?:[^"\\]|\\.)*"|\d{1,18}),$', re.MULTILINE
)


def all_reports(incidents: Path) -> list[Report]:
    """Return the newest LISTED_MAX incidents, newest first."""
    reports = [read_report(found) for found in _one_each(bundle.find_bundles(incidents))[:LISTED_MAX]]
    return sorted(reports, key=lambda one: (one.incident.opened_at or "", one.incident.id), reverse=True)


def find(incidents: Path, prefix: str) -> list[Found]:
    """Return the incidents whose id is `prefix`, or else begins with it."""
    known = _one_each(bundle.find_bundles(incidents))
    exact = [found for found in known if found.id == prefix]
    return exact or [found for found in known if prefix and found.id.startswith(prefix)]


def read_past(incidents: Path) -> list[Past]:
    """Return what the reports beside each other say of repetition, newest first, at most PAST_MAX."""
    found = _one_each(bundle.find_bundles(incidents))[:PAST_MAX]
    return [past for one in found if (past := _past(one)) is not None]


def read_report(found: Found, past: Sequence[Past] | None = None) -> Report:
    """Return the report of one incident's folder. `past` None: nothing is said of repetition and change."""
    manifest = bundle.read_manifest(found.path)
    opened_at = manifest.written_at or None if isinstance(manifest, Manifest) else None
    facts, process, recorder = (_json(found.path, name) for name in (_FACTS, "process.json", "recorder.json"))
    if not isinstance(facts, dict):  # it goes on, or its guard died
        facts = _json(found.path, bundle.OPENING)
    story = (
        incident.from_facts(found.id, facts)
        if isinstance(facts, dict)
        else incident.still_open(found.id, opened_at, recorder)
    )
    tape = read_tape(_text(found.path, "observations.jsonl"))
    story = structs.replace(_with_slots(story, recorder), versions=_versions(story, tape.policy_sha256))
    case = Case(
        incident=story,
        threads=read_threads(_json(found.path, "stacks.json")),
        process=incident.mapping(process),
        recorder=incident.mapping(recorder),
        traceback=_text(found.path, "stacks.txt"),
        first_threads=read_threads(_json(found.path, "stacks-first.json")),
        memory=incident.mapping(_json(found.path, "memory.json")),
        locks=incident.mapping(_json(found.path, "locks.json")),
        log=_text(found.path, "log.txt"),
        tape=tape,
        gateway=incident.mapping(_json(found.path, "gateway.json")),
    )
    return make_report(case, _contents(found, manifest), past)


def _past(found: Found) -> Past | None:
    head = bundle.read_head(found.path, "report.json", _PAST_BYTES_MAX)
    if isinstance(head, BundleFailed):
        return None
    fields = {match[1]: _value(match[2]) for match in _FIELD.finditer(head.decode("utf-8", "replace"))}
    return Past(
        id=found.id,
        opened_at=incident.moment(fields.get("opened_at")) or "",
        fingerprint=incident.text(fields.get("fingerprint")),
        versions=incident.Versions(
            build=incident.optional_text(fields.get("build")),
            policy=incident.optional_text(fields.get("policy_sha256")),
            schema=incident.number(fields.get("schema")),
        ),
    )


def _value(printed: str) -> object:
    try:
        parsed: object = json.loads(printed)
    except ValueError:
        return None
    return parsed


def _versions(story: incident.Incident, policy: str | None) -> incident.Versions:
    """Return what ran: as the facts say, and the policy by the recording where they don't."""
    known = story.versions
    return known if known.policy is not None else structs.replace(known, policy=policy)


def _one_each(found: list[Found]) -> list[Found]:
    """Keep one folder per incident: the whole one where there is a partial one beside it."""
    best: dict[str, Found] = {}
    for one in found:
        if one.id not in best or best[one.id].partial:
            best[one.id] = one
    return list(best.values())


def _with_slots(story: incident.Incident, recorder: object) -> incident.Incident:
    """Take the commands in flight from the recorder's page where the facts name none."""
    if story.in_flight:
        return story
    slots = incident.still_open(story.id, None, recorder).in_flight
    return structs.replace(story, in_flight=slots)


def _contents(found: Found, manifest: Manifest | BundleFailed) -> Contents:
    faults = tuple(bundle.verify_bundle(found.path))
    if isinstance(manifest, BundleFailed):
        return Contents(complete=False, partial=found.partial, files={}, missing={}, faults=faults)
    # Without the report itself, or a report made twice would differ from itself.
    files = {name: entry.size_bytes for name, entry in manifest.files.items() if name not in REPORTS}
    files |= manifest.images
    has_evidence = any(name.endswith("recorder.bin") for name in files)
    complete = manifest.complete and has_evidence and not manifest.missing and not faults
    return Contents(complete and not found.partial, found.partial, files, manifest.missing, faults)


def _json(path: Path, name: str) -> object:
    data = bundle.read_file(path, name)
    if isinstance(data, BundleFailed):
        return None
    try:
        parsed: object = json.loads(data)
    except (ValueError, RecursionError):
        return None
    return parsed


def _text(path: Path, name: str) -> str:
    data = bundle.read_file(path, name)
    return "" if isinstance(data, BundleFailed) else data.decode("utf-8", "replace")
