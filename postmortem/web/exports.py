"""An incident as a file to take away, in the forms that the command line knows; the redacted one is shown first."""

from types import MappingProxyType
from typing import Final

from starlette.requests import Request
from starlette.responses import Response

from postmortem import reading
from postmortem.cli import exported
from postmortem.reports.as_zip import pack
from postmortem.web import story
from postmortem.web.lobby import Lobby, reader_of

FORMS: Final = ("md", "html", "json", "zip")
_TYPES: Final = MappingProxyType(
    {
        "md": "text/markdown; charset=utf-8",
        "html": "text/html; charset=utf-8",
        "json": "application/json",
        "zip": "application/zip",
    }
)
_HERE: Final = "/admin/incidents"


async def export(lobby: Lobby, request: Request) -> Response:
    """GET /admin/incidents/{id}/export.{form}: always a file, never a page of this server."""
    form, lang = request.path_params["form"], reader_of(request).lang
    found = story.find(lobby.places.incidents, request.path_params["id"])
    if found is None or form not in FORMS:
        return lobby.lost(request, _HERE, _HERE)
    body = await lobby.read(lambda: exported(lobby.places.incidents, found, f".{form}", lang))
    await lobby.places.write_down("export", found.id, "", form)
    headers = {
        "Content-Disposition": f'attachment; filename="{found.id}.{form}"',
        "Content-Security-Policy": "default-src 'none'; sandbox",
        "X-Content-Type-Options": "nosniff",
        "Cache-Control": "no-store",
    }
    return Response(body, media_type=_TYPES[form], headers=headers)


async def preview(lobby: Lobby, request: Request) -> Response:
    """GET /admin/incidents/{id}/bundle: what the redacted export holds, and what it leaves out."""
    found, lang = story.find(lobby.places.incidents, request.path_params["id"]), reader_of(request).lang
    if found is None:
        return lobby.lost(request, _HERE, _HERE)
    packed = await lobby.read(lambda: pack(found, reading.read_report(found), lang))
    files = [(name, len(data)) for name, data in packed.files]
    return lobby.show(request, "bundle.html.j2", _HERE, id=found.id, files=files, lines=packed.lines)
