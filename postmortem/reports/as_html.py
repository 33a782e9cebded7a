"""Prints a report as one HTML page that needs nothing but itself: to be kept, sent, or opened years later.

Autoescape stands between the ledger's texts and the page, the drawings are inline SVG, and the page's own policy lets
nothing run and allows one style by its hash; so a hostile description is shown and does nothing, wherever the file is
opened. A link to a shared style sheet was not chosen: a saved page would lose its clothes.
"""

import base64
import hashlib
import re
from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from postmortem.reports.report import Report
from postmortem.reports.telling import telling
from postmortem.reports.visible import visible

_ROOT = Path(__file__).resolve().parents[2]
_STYLES = (_ROOT / "frontend" / "report.css", _ROOT / "frontend" / "static" / "drawings.css")
_COMMENT = re.compile(r"/\*.*?\*/\s*", re.DOTALL)


def as_html(report: Report, language: str) -> str:
    """Return the report as an HTML document."""
    sheet = style()
    digest = base64.b64encode(hashlib.sha256(sheet.encode()).digest()).decode()
    page = _environment().get_template("report.html.j2")
    ours = Markup(sheet)  # noqa: S704  two files of the checkout, word for word: their hash is what the policy allows
    return page.render(**telling(report, language), style=ours, style_hash=f"sha256-{digest}")


@cache
def style() -> str:
    """Return the one style of the page, as it stands in it."""
    sheet = "\n" + "".join(_COMMENT.sub("", path.read_text("utf-8")) for path in _STYLES)
    assert "</" not in sheet, "a style can't end its own element"
    return sheet


@cache
def _environment() -> Environment:
    return Environment(
        loader=FileSystemLoader(_ROOT / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_shown,
    )


def _shown(value: object) -> object:
    """Write out what can't be seen in a plain text; what is markup already is left alone."""
    return visible(value) if type(value) is str else value
