"""The table of the dashboard's addresses.

One line for each, so that all of them can be read at once; what a page shows stands in the room named beside it. No
address changes anything when it is only got: every act is a form that was posted with the token of one of our pages.
"""

import functools
from typing import Final

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from frontend.admin_paper import LANGUAGES, admin_files
from postmortem.views import Acts, Reads
from postmortem.web import (
    alerts,
    exports,
    incident,
    incidents,
    letter,
    letters,
    listing,
    now,
    policy,
    remains,
)
from postmortem.web.lobby import Lobby, field, lead_to
from postmortem.web.places import Places

_YEAR_S: Final = 365 * 86_400


def routes(reads: Reads, acts: Acts, places: Places) -> list[Route]:
    """Return the pages under `/admin/`, for the investigator's server."""
    lobby = Lobby(reads, acts, places)
    pages = {
        "/admin/": now.now,
        "/admin/incidents": incidents.incidents,
        "/admin/incidents.{form}": listing.listing,
        "/admin/incidents/{id}": incident.incident,
        "/admin/incidents/{id}/bundle": exports.preview,
        "/admin/incidents/{id}/export.{form}": exports.export,
        "/admin/dlq": letters.letters,
        "/admin/dlq/bulk/{id}": letters.progress,
        "/admin/dlq/{id}": letter.letter,
        "/admin/dlq/{id}/payload": letter.payload,
        "/admin/snapshots": remains.snapshots,
        "/admin/trends": remains.trends,
        "/admin/alerts": alerts.alerts,
        "/admin/policy": policy.policy,
        "/admin/settings": remains.settings,
        "/admin/static/{folder}/{name}": static,
    }
    forms = {
        "/admin/language": choose_language,
        "/admin/alerts/mute": alerts.mute,
        "/admin/alerts/test": alerts.test,
        "/admin/policy/reload": policy.reload,
        "/admin/restart": now.restart,
        "/admin/safe-mode": now.safe_mode,
        "/admin/drill": now.drill,
        "/admin/groups/{fingerprint}/fixed": incidents.mark_fixed,
        "/admin/groups/{fingerprint}/merge": incidents.merge,
        "/admin/groups/{fingerprint}/split": incidents.split,
        "/admin/incidents/{id}/note": incident.note,
        "/admin/incidents/{id}/remove": remains.remove,
        "/admin/incidents/{id}/reveal": incident.reveal,
        "/admin/proposals/{id}/{verb}": incident.decide,
        "/admin/dlq/bulk": letters.bulk,
        "/admin/dlq/bulk/{id}/cancel": letters.cancel,
        "/admin/dlq/{id}/reveal": letter.reveal,
        "/admin/dlq/{id}/{verb}": letter.act,
    }
    # The forms first: an address that is both is told apart by its method alone.
    return [
        *(Route(path, functools.partial(form, lobby), methods=["POST"]) for path, form in forms.items()),
        *(Route(path, functools.partial(page, lobby), methods=["GET"]) for path, page in pages.items()),
    ]


async def static(_lobby: Lobby, request: Request) -> Response:
    """GET /admin/static/{folder}/{name}: a file of the pages, for ever under the hash of them all."""
    folder, files = admin_files()
    file = files.get(request.path_params["name"])
    if file is None or request.path_params["folder"] != folder:
        return Response(status_code=404, headers={"Cache-Control": "no-store"})
    headers = {
        "Cache-Control": f"public, max-age={_YEAR_S}, immutable",
        "Content-Security-Policy": "default-src 'none'",
        "X-Content-Type-Options": "nosniff",
    }
    return Response(file.body, media_type=file.content_type, headers=headers)


async def choose_language(lobby: Lobby, request: Request) -> Response:
    """POST /admin/language: the same cookie that the ledger's pages and the gateway read."""
    form = await lobby.form(request)
    if isinstance(form, Response):
        return form
    back = field(form, "back")
    # The browser takes a backslash for a slash, and another server is two slashes away.
    safe = back.startswith("/admin/") and "\\" not in back and back.isprintable()
    response = lead_to(back if safe else "/admin/")
    lang = field(form, "lang")
    if lang in LANGUAGES:
        response.set_cookie("lang", lang, max_age=_YEAR_S, path="/", samesite="lax", httponly=False)
    return response
