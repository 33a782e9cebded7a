"""The pages of an import: choosing a file, and one import from its preview to its end.

They show what the import's API shows, in the same words; every step is a request to that API by the page's
script. Without a script a file can't be chosen here, and the page says so.
"""

from typing import Any

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from core.imports.desk import Desk
from core.imports.reading.formats import builtin_formats
from core.imports.reading.lettering import ENCODINGS
from core.imports.troubles import Trouble
from core.web import pages_book
from core.web.asking import read, service_of
from core.web.import_views import summary_of, view_of
from core.web.pages import HOME_CURRENCY
from core.web.pages_answers import reader_of, show
from core.web.problems import Problem, ProblemError


async def imports(request: Request) -> Response:
    """GET /import."""
    seq, reader = service_of(request).head_seq, reader_of(request)
    found = await _desk(request).newest()
    shown = [msgspec.to_builtins(summary_of(kept, reader.lang)) for kept in found]
    banks = sorted({form.name[reader.lang] for form in builtin_formats().values()})
    return show(request, "imports.html.j2", "/import", seq=seq, imports=shown, banks=banks)


async def one_import(request: Request) -> Response:
    """GET /import/{id}."""
    seq, reader = service_of(request).head_seq, reader_of(request)
    kept = await _desk(request).get(request.path_params["id"])
    if isinstance(kept, Trouble):
        raise ProblemError(Problem(kept.slug, values=dict(kept.values)))
    made: dict[str, Any] = msgspec.to_builtins(view_of(kept, reader.lang))
    return show(
        request,
        "import.html.j2",
        "/import",
        seq=seq,
        made=made,
        accounts=await read(request, "page.import", pages_book.money_accounts),
        encodings=list(ENCODINGS),
        currency_here=HOME_CURRENCY[reader.lang],
    )


def _desk(request: Request) -> Desk:
    desk: Desk = request.app.state.desk
    return desk
