"""The list of incidents as a file: every line that fits the filter, for a spreadsheet or a program.

What a spreadsheet would take for a formula is written as text, because accounts and sentences hold what other people
wrote. The file is made of the same lines as the page, so that both say the same.
"""

import csv
import io
import json
from collections.abc import Sequence
from types import MappingProxyType
from typing import Any, Final

from msgspec import structs
from starlette.requests import Request
from starlette.responses import Response

from postmortem.reports.visible import visible
from postmortem.views import Filter, IncidentLine, Reads
from postmortem.web.incidents import HERE, filter_of
from postmortem.web.lobby import Lobby, reader_of

LINES_MAX: Final = 10_000
PIECE_LINES: Final = 500
#: What begins a formula in one spreadsheet or another.
FORMULA_STARTS: Final = ("=", "+", "-", "@")
COLUMNS: Final = (
    "id", "opened_at", "closed_at", "diagnosis", "grade", "outcome", "outage_ms", "detected_ms", "fingerprint",
    "account_ids", "planned", "drill", "summary",
)  # fmt: skip
_TYPES: Final = MappingProxyType({"csv": "text/csv; charset=utf-8", "json": "application/json"})


async def listing(lobby: Lobby, request: Request) -> Response:
    """GET /admin/incidents.{form}: the incidents that fit a filter, at most LINES_MAX, as a file."""
    form, wanted, lang = request.path_params["form"], filter_of(request.query_params), reader_of(request).lang
    if form not in _TYPES:
        return lobby.lost(request, HERE, HERE)
    lines = await lobby.read(lambda: _every(lobby.reads, wanted))
    body = (
        _as_csv(lines, lang)
        if form == "csv"
        else json.dumps([structs.asdict(one) for one in lines], ensure_ascii=False)
    )
    await lobby.places.write_down("export", "incidents", "", form)
    headers = {
        "Content-Disposition": f'attachment; filename="incidents.{form}"',
        "Content-Security-Policy": "default-src 'none'; sandbox",
        "X-Content-Type-Options": "nosniff",
        "Cache-Control": "no-store",
    }
    return Response(body.encode("utf-8", "replace"), media_type=_TYPES[form], headers=headers)


def _every(reads: Reads, wanted: Filter) -> list[IncidentLine]:
    lines: list[IncidentLine] = []
    cursor: str | None = ""
    while cursor is not None and len(lines) < LINES_MAX:
        page = reads.incidents(wanted, PIECE_LINES, cursor)
        lines += page.items
        cursor = page.more
    return lines[:LINES_MAX]


def _as_csv(lines: Sequence[IncidentLine], lang: str) -> str:
    paper = io.StringIO(newline="")
    # With a mark of its encoding: spreadsheets take a file without one for something older.
    paper.write("\ufeff")
    writer = csv.writer(paper)
    writer.writerow(COLUMNS)
    for line in lines:
        row: dict[str, Any] = structs.asdict(line)
        row |= {"account_ids": " ".join(line.account_ids), "summary": line.summary.get(lang, "")}
        writer.writerow([_cell(row[name]) for name in COLUMNS])
    return paper.getvalue()


def _cell(value: object) -> str:
    if value is None or isinstance(value, bool):
        return {None: "", True: "yes", False: "no"}[value]
    said = visible(str(value))
    return f"'{said}" if isinstance(value, str) and said.startswith(FORMULA_STARTS) else said
