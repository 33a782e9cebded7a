"""What the command line asks of the investigators: list, show, export, and the report of a closed incident.

Works from files alone, so it answers with everything stopped. Its import is light on purpose: `hardcore
status` pays for it too. What can't be done is a `Refused` with a sentence that names the next step.
"""

import json
import os
import shutil
import sys
from pathlib import Path
from typing import Any

import msgspec

from postmortem import bundle, reading
from postmortem.bundle import BundleFailed, Found
from postmortem.reports import as_terminal
from postmortem.reports.as_json import as_item, as_story
from postmortem.reports.as_terminal import Look, Write
from postmortem.reports.report import LANGUAGES, Report, money_line, refusal
from postmortem.reports.visible import visible

#: The endings of files that an incident is exported to.
EXPORTS = (".md", ".json", ".html", ".zip")
_EXAMPLES_MAX = 3


class Refused(msgspec.Struct, frozen=True):
    """Something could not be done; `sentence` tells a person why and what to do next."""

    sentence: str


def list_incidents(incidents: Path, lang: str = "en") -> list[dict[str, Any]]:
    """Return the incidents in folder `incidents`, newest first, as the JSON of the list."""
    return [as_item(report, lang) for report in reading.all_reports(incidents)]


def show_incident(incidents: Path, incident_id: str, lang: str = "en") -> dict[str, Any] | Refused:
    """Return everything about one incident; its id may be shortened to a beginning that is its alone."""
    found = _one(incidents, incident_id, lang)
    return found if isinstance(found, Refused) else _story(incidents, found, lang)


def find_incident(incidents: Path, incident_id: str, lang: str = "en") -> Found | Refused:
    """Return the folder of one incident; its id may be shortened to a beginning that is its alone."""
    return _one(incidents, incident_id, lang)


def print_list(items: list[dict[str, Any]], lang: str, write: Write, look: Look | None = None) -> None:
    """Print what `list_incidents` returned. `look` None: as the terminal and NO_COLOR want it."""
    as_terminal.print_list(items, lang, write, look or terminal_look())


def print_show(story: dict[str, Any], lang: str, write: Write, look: Look | None = None) -> None:
    """Print what `show_incident` returned. `look` None: as the terminal and NO_COLOR want it."""
    as_terminal.print_show(story, lang, write, look or terminal_look())


def export(incidents: Path, incident_id: str, out: Path, lang: str = "en") -> Refused | None:
    """Write one incident to `out`, in the form of its ending. None: written, for its owner only."""
    if out.suffix not in EXPORTS:
        return Refused(refusal("bad_ending", lang, name=out.name))
    found = _one(incidents, incident_id, lang)
    if isinstance(found, Refused):
        return found
    data = exported(incidents, found, out.suffix, lang)
    try:
        handle = os.open(out, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
        with os.fdopen(handle, "wb") as file:
            file.write(data)
    except OSError as error:
        return Refused(refusal("not_written", lang, name=out.name, reason=error.strerror))
    return None


def exported(incidents: Path, found: Found, ending: str, lang: str) -> bytes:
    """Return one incident in the form of a file's ending, one of EXPORTS."""
    report = reading.read_report(found, reading.read_past(incidents))
    match ending:
        case ".json":
            return _encoded(_json(as_story(report, lang)))
        case ".md":
            return _encoded(_markdown(report, lang))
        case ".html":
            return _encoded(_html(report, lang))
        case ".zip":
            return _zip(found, report, lang)
        case _:
            raise AssertionError(ending)


def export_preview(incidents: Path, incident_id: str, lang: str = "en") -> list[str] | Refused:
    """Return what the redacted archive of one incident leaves out or hides, one line each; nothing is written."""
    # Here, as below: the papers' engine takes longer to load than a list takes to print.
    from postmortem.reports.as_zip import pack

    found = _one(incidents, incident_id, lang)
    return found if isinstance(found, Refused) else list(pack(found, reading.read_report(found), lang).lines)


def write_report(folder: Path, lang: str = "en") -> BundleFailed | None:
    """Make `report.json` and `report.md` of an incident's folder; made twice, they are the same."""
    if not bundle.is_incident_id(folder.name):
        return BundleFailed(f"{folder.name!r} is not an incident's folder")
    report = reading.read_report(Found(folder.name, folder, partial=False), reading.read_past(folder.parent))
    files = {"report.json": _json(as_story(report, lang)), "report.md": _markdown(report, lang)}
    return bundle.add_files(folder, {name: _encoded(text) for name, text in files.items()}, {})


def terminal_look() -> Look:
    """Return how to print on this process's terminal: its width, and colour unless NO_COLOR is set."""
    width = shutil.get_terminal_size((80, 24)).columns
    colour = sys.stdout.isatty() and not os.environ.get("NO_COLOR")
    return Look(min(max(width, as_terminal.WIDTH_MIN), as_terminal.WIDTH_MAX), colour)


def _one(incidents: Path, incident_id: str, lang: str) -> Found | Refused:
    found = reading.find(incidents, incident_id)
    shown = as_terminal.cut(visible(incident_id), 64)
    if not found:
        return Refused(refusal("unknown", lang, id=shown))
    if len(found) > 1:
        examples = ", ".join(one.id for one in found[:_EXAMPLES_MAX])
        return Refused(refusal("ambiguous", lang, id=shown, count=len(found), examples=examples))
    return found[0]


def _story(incidents: Path, found: Found, lang: str) -> dict[str, Any]:
    report = reading.read_report(found, reading.read_past(incidents))
    lines = {language: money_line(report, language) for language in LANGUAGES}
    return {**as_story(report, lang), "money_line": lines, "folder": str(found.path)}


def _markdown(report: Report, lang: str) -> str:
    # Here, because the template engine takes longer to load than a list takes to print.
    from postmortem.reports.as_markdown import as_markdown

    return as_markdown(report, lang)


def _html(report: Report, lang: str) -> str:
    # Here, for the same reason.
    from postmortem.reports.as_html import as_html

    return as_html(report, lang)


def _zip(found: Found, report: Report, lang: str) -> bytes:
    # Here, for the same reason.
    from postmortem.reports.as_zip import as_zip, pack

    return as_zip(pack(found, report, lang).files)


def _json(story: dict[str, Any]) -> str:
    return json.dumps(story, ensure_ascii=False, indent=1) + "\n"


def _encoded(text: str) -> bytes:
    # A lone surrogate is the one thing UTF-8 can't carry; as an escape it is valid in JSON as well.
    return text.encode("utf-8", "backslashreplace")
