"""Prints a report as Markdown for people, in one language.

Every value that the template prints passes through one escape, so that a description typed into the ledger
can neither break out of its line nor carry a terminal's control characters into whoever shows the file.
HTML's autoescape would have been the wrong tongue: what is special to Markdown is not what is special to it.
"""

import re
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from postmortem.reports.report import Report
from postmortem.reports.telling import telling
from postmortem.reports.visible import visible

_TEMPLATES = Path(__file__).resolve().parents[2] / "templates"

_SPECIAL = re.compile(r"[\\`*\[\]<>|#~]|(?<![^\W_])_|_(?![^\W_])")


def as_markdown(report: Report, language: str) -> str:
    """Return the report as a Markdown document."""
    return _environment().get_template("report.md.j2").render(**telling(report, language))


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
