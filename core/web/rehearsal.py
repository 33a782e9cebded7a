"""A rehearsal: every question that can be asked of the core, asked once by nobody, before anybody waits for the answer.

What a program does for the first time it does slowly: a template is compiled, a statement is put into words, a module
is imported in the middle of a request. A core that waits to be promoted has the time to do all of that before. It is
done by asking the application itself, so a page that is added is rehearsed without anybody thinking of it. Only
questions: a write would need another ledger than the household's. Not chosen: a list of what is loaded lazily, here
or in the libraries below; the next version of any of them would make it wrong without a word.
"""

import asyncio
import re
from typing import Final

from starlette.types import ASGIApp, Message, Scope

from core.imports.reading.formats import builtin_formats
from core.web.app import ROUTES
from core.web.openapi import document
from core.web.pages_table import PAGES
from frontend.assets import assets
from frontend.paper import load_templates

READERS: Final = (("ko", "text/html"), ("en", "text/html"), ("en", "application/json"))
REST_S: Final = 0.005  # between two questions: somebody else is being served meanwhile
UNASKED: Final = frozenset({"/api/ledger/verify"})  # a proof of the whole book takes as long as it takes
NOBODY: Final = "00000000-0000-0000-0000-000000000000"  # what no import, entry or account is called
_PARAMETER: Final = re.compile(r"\{[^}]*\}")

PATHS: Final = tuple(
    _PARAMETER.sub(NOBODY, path)
    for path, methods in {**ROUTES, **PAGES}.items()
    if "GET" in methods and path not in UNASKED
)


def load() -> None:
    """Load what is otherwise loaded at its first use: templates, files of pages, formats of banks."""
    load_templates()
    assets()
    builtin_formats()
    document()


async def rehearse(app: ASGIApp) -> None:
    """Ask every question once in every language, as a page and as a program would."""
    for path in PATHS:
        for lang, accept in READERS:
            await app(_asked(path, lang, accept), _no_body, _unheard)
            await asyncio.sleep(REST_S)


def _asked(path: str, lang: str, accept: str) -> Scope:
    names = {"host": "rehearsal", "accept": accept, "accept-language": lang}
    return {
        "type": "http",
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "method": "GET",
        "scheme": "http",
        "path": path,
        "raw_path": path.encode(),
        "query_string": b"",
        "root_path": "",
        "headers": [(name.encode(), value.encode()) for name, value in names.items()],
        "client": None,
        "server": None,
    }


async def _no_body() -> Message:
    return {"type": "http.request", "body": b"", "more_body": False}


async def _unheard(_: Message) -> None:
    pass
