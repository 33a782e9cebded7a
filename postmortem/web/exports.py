"""An incident as a file to take away, in the forms that the command line knows."""

import json
from typing import Final

from starlette.requests import Request
from starlette.responses import Response

from postmortem import reading
from postmortem.reports.as_json import as_story
from postmortem.reports.as_markdown import as_markdown
from postmortem.web import story
from postmortem.web.lobby import Lobby, reader_of

FORMS: Final = ("md", "json")
_TYPES: Final = {"md": "text/markdown; charset=utf-8", "json": "application/json"}
_HERE: Final = "/admin/incidents"


async def export(lobby: Lobby, request: Request) -> Response:
    """GET /admin/incidents/{id}/export.{form}."""
    form, lang = request.path_params["form"], reader_of(request).lang
    found = story.find(lobby.places.incidents, request.path_params["id"])
    if found is None or form not in FORMS:
        return lobby.lost(request, _HERE, _HERE)
    report = await lobby.read(lambda: reading.read_report(found))
    body = (
        as_markdown(report, lang)
        if form == "md"
        else json.dumps(as_story(report, lang), ensure_ascii=False, indent=1)
    )
    headers = {
        "Content-Disposition": f'attachment; filename="{found.id}.{form}"',
        "Content-Security-Policy": "default-src 'none'; sandbox",
        "X-Content-Type-Options": "nosniff",
        "Cache-Control": "no-store",
    }
    return Response(body.encode("utf-8", "replace"), media_type=_TYPES[form], headers=headers)
