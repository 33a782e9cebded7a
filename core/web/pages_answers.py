"""How a page is sent: who reads it, the headers of every page, and a problem as a page.

A page comes with a policy that allows nothing from elsewhere and nothing inline, and it is never stored, because
money stands on it. A problem is told as a page to whoever asked for one and as problem+json to everybody else;
status and headers are the same in both, because a gateway acts on them.
"""

import datetime as dt
from types import MappingProxyType
from typing import Any, Final

import msgspec
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response

from core.web.asking import service_of
from core.web.problems import PROBLEM_JSON, Problem, headers_of, problem_json
from frontend.paper import Reader, draw, page_text, reader_language
from frontend.render import problem_text, read_only_because

LANGUAGE_COOKIE: Final = "lang"
ACCOUNT_COOKIE: Final = "account"  # what this browser booked on last: the next form begins with it
COOKIE_CHARACTERS_MAX: Final = 8
NAME_CHARACTERS_MAX: Final = 64  # of who is signed in
PAGE_HEADERS: Final = MappingProxyType(
    {
        "Content-Security-Policy": (
            "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
            "connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
        ),
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "same-origin",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Cache-Control": "no-store",
        "Vary": "Accept-Language, Cookie",
    }
)


def reader_of(request: Request) -> Reader:
    """Return who reads this page."""
    cookie = request.cookies.get(LANGUAGE_COOKIE, "")[:COOKIE_CHARACTERS_MAX]
    lang = reader_language(cookie, request.headers.get("accept-language"))
    # Where the choice of another language leads back to; what was posted to can't be got.
    path = f"{request.url.path}?{request.url.query}" if request.method == "GET" else "/"
    # The day of the household's machine; the browser corrects a fresh form to its own.
    return Reader(lang, dt.datetime.now().astimezone().date(), path, _who(request))


def _who(request: Request) -> str:
    """Who is signed in, as the gateway says it on our own socket; anywhere else anybody could."""
    server = request.scope.get("server")
    own = server is None or server[1] is None
    return request.headers.get("x-actor", "")[:NAME_CHARACTERS_MAX] if own else ""


def wants_page(request: Request) -> bool:
    """Whether this request is answered with a page where it can't be served."""
    return not request.url.path.startswith("/api/") and "text/html" in request.headers.get("accept", "")


def show(
    request: Request, template: str, here: str, *, status: int = 200, key: str | None = None, **values: Any
) -> Response:
    """Return a page. `here` is the way in the header that it belongs to.

    Each form gets a fresh key; `key` is for a form whose wish nobody has answered yet, so that sending it again
    can't do it twice.
    """
    service = service_of(request)
    html = draw(
        template,
        reader_of(request),
        here=here,
        # Before the page was read: what is booked in between is told twice rather than never.
        seq=values.pop("seq", service.head_seq),
        safe=read_only_because(service.safe, reader_of(request).lang) if service.safe else None,
        fresh_key=lambda: key or service.new_id(),
        **values,
    )
    return HTMLResponse(html, status, dict(PAGE_HEADERS))


def show_problem(request: Request, problem: Problem) -> Response:
    """Return the page that tells a problem, with everything that its answer to a program would say in headers."""
    title, detail = problem_text(problem.slug, reader_of(request).lang, **problem.values)
    response = show(request, "problem.html.j2", "", status=problem.told_status, title=title, detail=detail)
    response.headers.update(headers_of(problem, service_of(request).settings))
    return response


def tell_script(request: Request, problem: Problem, faults: dict[str, str]) -> Response:
    """Return the same to the script of a page: the problem, and a sentence for each of its fields."""
    reader = reader_of(request)
    settings = service_of(request).settings
    body = {**problem_json(problem, reader.lang, settings), "faults": faults}
    headers = {
        "Content-Language": reader.lang,
        "Cache-Control": "no-store",
        **headers_of(problem, settings),
    }
    return Response(msgspec.json.encode(body), problem.told_status, headers, media_type=PROBLEM_JSON)


def text_for(request: Request, name: str, **values: object) -> str:
    """Return a text of the pages in the reader's language."""
    return page_text(name, reader_of(request).lang, **values)
