"""The application: which path is answered by which handler, and what becomes of everything else.

The table of routes is the whole surface; `openapi.py` describes the same table and a test holds them together.
No path is redirected and no error page is a framework's: what is not in the table is a problem in the
reader's language.
"""

from typing import Final

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp

from core.imports.desk import Desk
from core.service import Service
from core.web import (
    assertions,
    batches,
    entries,
    exporting,
    handlers,
    import_handlers,
    plans,
    two_phases,
)
from core.web.asking import Handler, Routes, service_of
from core.web.door import Door
from core.web.live import live
from core.web.openapi import document
from core.web.pages_answers import show_problem, wants_page
from core.web.pages_table import PAGES
from core.web.problems import Outcome, Problem, ProblemError, respond
from core.web.same_origin import SAFE_METHODS, is_foreign
from frontend.render import language

ROUTES: Final[Routes] = {
    "/api/ledger/accounts": {"GET": handlers.list_accounts, "POST": handlers.create_account},
    "/api/ledger/accounts/{id}": {"GET": handlers.get_account},
    "/api/ledger/accounts/{id}/close": {"POST": handlers.close},
    "/api/ledger/transactions": {"GET": handlers.list_transactions, "POST": handlers.create_transaction},
    "/api/ledger/transactions/{id}": {"GET": handlers.get_transaction},
    "/api/ledger/events": {"GET": handlers.list_events},
    "/api/ledger/verify": {"GET": handlers.get_verdict},
    "/api/ledger/drill": {"POST": handlers.drill},
    # A key may hold a slash; the path arrives decoded.
    "/api/ledger/commands/{key:path}": {"GET": handlers.look_up},
    **two_phases.ROUTES,
    **assertions.ROUTES,
    **batches.ROUTES,
    **plans.ROUTES,
    **import_handlers.ROUTES,
    **exporting.ROUTES,
    "/healthz": {"GET": handlers.health},
    **entries.ROUTES,
}


def make_app(service: Service, desk: Desk, app: Starlette | None = None) -> ASGIApp:
    """Return the application in front of a service and its imports. `app`: what `lay_out` has made already."""
    app = app or lay_out()
    app.state.service = service
    app.state.desk = desk
    return Door(app, service)


def lay_out() -> Starlette:
    """Return the application without anybody behind it: every path, and who answers."""
    described = document()

    async def openapi(_: Request) -> Response:
        return Response(described, media_type="application/json")

    tables: Routes = {**ROUTES, **PAGES, "/api/openapi.json": {"GET": openapi}}
    routes = [Route(path, _by_method(table), methods=list(table)) for path, table in tables.items()]
    app = Starlette(
        routes=[*routes, WebSocketRoute("/ws", live)],
        exception_handlers={
            ProblemError: _tell_problem,
            HTTPException: _tell_unrouted,
            ClientDisconnect: _tell_nobody,
            Exception: _tell_bug,
        },
    )
    app.router.redirect_slashes = False
    return app


def _by_method(table: dict[str, Handler]) -> Handler:
    async def dispatch(request: Request) -> Response:
        if is_foreign(request):
            raise ProblemError(Problem("foreign-page"))
        return await table["GET" if request.method == "HEAD" else request.method](request)

    return dispatch


def _respond(request: Request, problem: Problem) -> Response:
    if wants_page(request):
        return show_problem(request, problem)
    lang = language(request.headers.get("accept-language"))
    return respond(problem, lang, service_of(request).settings)


async def _tell_problem(request: Request, error: Exception) -> Response:
    assert isinstance(error, ProblemError)
    return _respond(request, error.problem)


async def _tell_unrouted(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    if error.status_code == 405:
        allowed = ", ".join(sorted(str((error.headers or {}).get("Allow", "")).split(", ")))
        problem = Problem("method-not-allowed", values={"allowed": allowed}, headers={"Allow": allowed})
        return _respond(request, problem)
    assert error.status_code == 404, "the framework ends a request by itself only where there is no route"
    return _respond(request, Problem("not-found"))


async def _tell_nobody(_: Request, __: Exception) -> Response:
    return Response(status_code=400)  # the client left in the middle of its body: nobody reads this


async def _tell_bug(request: Request, _: Exception) -> Response:
    # The server logs the traceback. The client hears no more than that it can't know what was done.
    outcome = None if request.method in SAFE_METHODS else Outcome.UNKNOWN
    return _respond(request, Problem("internal", outcome=outcome))
