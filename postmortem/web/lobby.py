"""What every page needs: who reads it, the headers it is sent with, and whether a form came from one of our pages.

A form is answered by a page again: done, it leads back with a code of what happened (never with a sentence, which
somebody else could write into an address); not done, it says why. Every reading of the archive happens on a thread,
so that one slow disk does not stop the others' pages.
"""

import hmac
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final, TypeVar

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import FormData
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response

from frontend import catalogue_letters
from frontend.admin_paper import AdminReader, admin_language, admin_text, draw_admin, knows
from frontend.render import Language
from postmortem.views import Acts, Reads, Refusal
from postmortem.web.places import Places

Asked = TypeVar("Asked")

HEADERS: Final = MappingProxyType(
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
FIELDS_MAX: Final = 1_200  # 500 letters are selected at once at most, and a few fields beside them
FIELD_BYTES_MAX: Final = 16 << 10
FORM_BYTES_MAX: Final = 256 << 10
#: From another site a form is not obeyed, whatever it carries; a browser too old to say where it stands sends a token.
_OWN_SITES: Final = frozenset({"same-origin", "none", None})


class Question(msgspec.Struct, frozen=True):
    """What is asked before something is done.

    `sure`: the button's word, empty where there is nothing to be sure of. `typed`: name, label and most characters of what has to be written. `fields`: what is sent with the answer.
    """

    title: str
    action: str
    sure: str
    back: str
    keep: str
    lines: Sequence[str] = ()
    fields: Sequence[tuple[str, str]] = ()
    typed: tuple[str, str, int] | None = None
    fault: str = ""
    harms: bool = False


class Lobby(msgspec.Struct, frozen=True):
    """The archive, what may be done with it, and what is outside of it: for every page the same."""

    reads: Reads
    acts: Acts
    places: Places

    async def read(self, question: Callable[[], Asked]) -> Asked:
        """Return what a reading of the archive or of a folder says."""
        return await run_in_threadpool(question)

    def show(
        self,
        request: Request,
        template: str,
        here: str,
        *,
        status: int = 200,
        refused: str = "",
        **values: Any,
    ) -> Response:
        """Return a page. `refused`: the code of why what was asked was not done."""
        reader = reader_of(request)
        code = refused or request.query_params.get("said", "")
        page = draw_admin(
            template,
            reader,
            here=here,
            csrf=self.places.token,
            version=self.places.version,
            said=said(code, reader.lang),
            wrong=code.startswith(("refused", "guard_")),
            **values,
        )
        # Half a surrogate pair, which JSON can carry, is no character of any page.
        return HTMLResponse(page.encode("utf-8", "backslashreplace"), status, headers=dict(HEADERS))

    def ask(self, request: Request, here: str, question: Question, *, status: int = 200) -> Response:
        """Return the page that asks before something is done."""
        return self.show(request, "confirm.html.j2", here, status=status, ask=question)

    def refuse(self, request: Request, here: str, refusal: Refusal, back: str) -> Response:
        """Return the page that says why something was not done; it takes a question's place, also in a dialog."""
        words = words_of(request)
        why = catalogue_letters.refusal(refusal.code, reader_of(request).lang, refusal.values)
        question = Question(words("said_refused"), "", "", back, words("back"), (why,))
        return self.ask(request, here, question, status=409)

    def lost(self, request: Request, here: str, back: str) -> Response:
        """Return the page for what is not there."""
        words = words_of(request)
        title, more = words("lost_title"), words("lost_more")
        return self.show(request, "lost.html.j2", here, status=404, title=title, more=more, back=back)

    async def form(self, request: Request) -> FormData | Response:
        """Return what a form of ours says; the page that says no where it is not from one of our pages."""
        length = request.headers.get("content-length", "0")
        small = length.isascii() and length.isdigit() and int(length) <= FORM_BYTES_MAX
        if small and request.headers.get("sec-fetch-site") in _OWN_SITES:
            form = await request.form(max_files=0, max_fields=FIELDS_MAX, max_part_size=FIELD_BYTES_MAX)
            if hmac.compare_digest(field(form, "_csrf").encode(), self.places.token.encode()):
                return form
        words = words_of(request)
        title, more = words("stale_title"), words("stale_more")
        return self.show(request, "lost.html.j2", "", status=403, title=title, more=more, back="/admin/")


def reader_of(request: Request) -> AdminReader:
    """Return who reads this page."""
    lang = admin_language(request.cookies.get("lang", "")[:8], request.headers.get("accept-language"))
    path = f"{request.url.path}?{request.url.query}" if request.method == "GET" else "/admin/"
    return AdminReader(lang, path)


def words_of(request: Request) -> Callable[..., str]:
    """Return the function that says a text in the reader's language."""
    lang = reader_of(request).lang

    def words(name: str, /, **values: object) -> str:
        return admin_text(name, lang, **values)

    return words


def field(form: FormData | Mapping[str, Any], name: str) -> str:
    """Return a field of a form as text; a file or nothing is an empty one."""
    value = form.get(name, "")
    return value.strip() if isinstance(value, str) else ""


def is_sure(form: FormData) -> bool:
    """Tell whether the form answers a question that was asked."""
    return field(form, "sure") == "1"


def lead_to(path: str, code: str = "") -> Response:
    """Return the way back to a page after a form, with the code of what happened."""
    assert path.startswith("/admin/"), path
    headers = {"Cache-Control": "no-store"}
    return RedirectResponse(f"{path}?said={code}" if code else path, 303, headers=headers)


def said(code: str, lang: Language) -> str:
    """Return the sentence for a code of what happened; nothing for a code that is none of ours."""
    for name in (code, f"said_{code}"):
        if name.startswith(("said_", "refused_")) and knows(name):
            return admin_text(name, lang)
    return ""
