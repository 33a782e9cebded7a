"""The files of the pages over HTTP: from memory, named by their content, kept by browsers for as long as they like."""

from typing import Final

from starlette.requests import Request
from starlette.responses import Response

from core.web.problems import Problem, ProblemError
from frontend.assets import assets

_FOR_EVER: Final = "public, max-age=31536000, immutable"


async def asset(request: Request) -> Response:
    """GET /static/{folder}/{name}."""
    kept = assets()
    found = kept.files.get(request.path_params["name"])
    # Another version's folder is nobody's: to answer it with today's bytes would be kept for ever under a false name.
    if found is None or request.path_params["folder"] != kept.folder:
        raise ProblemError(Problem("not-found"))
    headers = {
        "Cache-Control": _FOR_EVER,
        "ETag": found.etag,
        "Vary": "Accept-Encoding",
        "X-Content-Type-Options": "nosniff",
        "Content-Security-Policy": "default-src 'none'",
    }
    if found.etag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    if "gzip" in request.headers.get("accept-encoding", ""):
        return Response(
            found.packed, headers={**headers, "Content-Encoding": "gzip"}, media_type=found.content_type
        )
    return Response(found.body, headers=headers, media_type=found.content_type)
