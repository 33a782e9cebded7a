"""Who may ask the investigator for what: the gate before every page and every act.

An ASGI layer around all of it. A request has to come through the gateway or from this machine's owner (`X-Admin: 1`, which
the gateway alone may say for a browser); an act has to carry the word that our own pages and `GET /admin/api/token` give,
and must not come from a page of somebody else's. Its body is read here, whole and bounded, because a form carries the word
inside. A middleware of the framework was not chosen: what guards every address should not depend on the order of a list.
"""

import hmac
import json
import re
import time
from collections.abc import Iterable
from typing import Any, Final
from urllib.parse import parse_qs, urlencode, urlsplit

import msgspec
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from postmortem.diary import SPEAKER

BODY_BYTES_MAX: Final = 1 << 20
FIELDS_MAX: Final = 5_000
SAFE: Final = frozenset({"GET", "HEAD"})
#: What a browser says of a request that one of our own pages, or its address bar, sends.
_OUR_SITES: Final = frozenset({"same-origin", "none"})

#: What can't be taken back, or shows what is private: asks for a password that was typed just now, where one is set.
_PROVEN: Final = re.compile(
    r"/admin/(?:restart|safe-mode|drill|dlq/bulk|(?:dlq|incidents)/[^/]+/(?:discard|reveal|remove)"
    r"|dlq/[^/]+/payload|incidents/[^/]+/(?:bundle|export\.\w+)|api/letters/(?:bulk|[^/]+/discard)|api/incidents/[^/]+/remove-evidence)"
)
_SIGN_IN: Final = "/__hc/sign-in"

_HEADERS: Final = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
)


class Gate(msgspec.Struct):
    """The gate. `asked_ns`: when somebody asked last, `open`: how many are being answered."""

    app: ASGIApp
    token: str
    asked_ns: int = msgspec.field(default_factory=time.monotonic_ns)
    open: int = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let one request through, or answer it here."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        self.open += 1
        try:
            await self._answer(scope, receive, send)
        finally:
            self.open -= 1
            self.asked_ns = time.monotonic_ns()

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        given = Given(scope["headers"])
        SPEAKER.set("program" if scope["path"].startswith("/admin/api/") else "dashboard")
        if given.one("x-hardcore-cli") == "1" and given.one("sec-fetch-site") == "":
            SPEAKER.set("cli")
        if given.one("x-admin") != "1":
            await _refuse(send, 403, "admin-local")
        elif given.one("x-proven") == "0" and _asks_for_proof(scope["path"]):
            await _ask_again(send, scope, given)
        elif scope["method"] in SAFE:
            await self.app(scope, receive, _with_headers(send))
        elif scope["method"] != "POST":
            await _refuse(send, 405, "method-not-allowed")
        elif not is_ours(given):
            await _refuse(send, 403, "foreign-page")
        elif (body := await _read(receive)) is None:
            await _refuse(send, 413, "body-too-large")
        elif not hmac.compare_digest(_word(given, body).encode(), self.token.encode()):
            await _refuse(send, 403, "token-needed")
        else:
            await self.app(scope, _again(body, receive), _with_headers(send))


class Given:
    """The headers of a request, by their names in small letters."""

    def __init__(self, headers: Iterable[tuple[bytes, bytes]]) -> None:
        self._all = [(name.decode("latin-1").lower(), value.decode("latin-1")) for name, value in headers]

    def one(self, name: str) -> str:
        """The value of a header; empty where it is absent or said twice."""
        values = [value for given, value in self._all if given == name]
        return values[0] if len(values) == 1 else ""

    def has(self, name: str) -> bool:
        """Tell whether a header is there at all."""
        return any(given == name for given, _ in self._all)


def is_ours(given: Given) -> bool:
    """Tell whether a request comes from a page of ours, or from no page at all."""
    if given.has("sec-fetch-site") and given.one("sec-fetch-site") not in _OUR_SITES:
        return False
    if not given.has("origin"):
        return True
    origin = urlsplit(given.one("origin"))
    return origin.scheme in ("http", "https") and origin.netloc != "" and origin.netloc == given.one("host")


def _asks_for_proof(path: str) -> bool:
    # The routes take an address with a line's end behind it (`%0a`) for the one without.
    return _PROVEN.fullmatch(path.removesuffix("\n")) is not None


def _word(given: Given, body: bytes) -> str:
    if given.one("x-csrf"):
        return given.one("x-csrf")
    if not given.one("content-type").lower().startswith("application/x-www-form-urlencoded"):
        return ""
    try:
        fields = parse_qs(body.decode(), max_num_fields=FIELDS_MAX)
    except ValueError:
        return ""
    return fields.get("_csrf", [""])[0]


async def _read(receive: Receive) -> bytes | None:
    """The whole body, or None where it is too large or its sender has gone."""
    body = b""
    while True:
        message = await receive()
        if message["type"] != "http.request":
            return None
        part: bytes = message.get("body", b"")
        body += part
        if len(body) > BODY_BYTES_MAX:
            return None
        if not message.get("more_body", False):
            return body


def _again(body: bytes, receive: Receive) -> Receive:
    """Give a body that was read to who reads it next, then what its sender does."""
    waiting: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def given() -> Message:
        return waiting.pop() if waiting else await receive()

    return given


def _with_headers(send: Send) -> Send:
    async def said(message: Message) -> None:
        if message["type"] == "http.response.start":
            present = {name.lower() for name, _ in message.get("headers", ())}
            more = [(name, value) for name, value in _HEADERS if name not in present]
            message = {**message, "headers": [*message.get("headers", ()), *more]}
        await send(message)

    return said


async def _ask_again(send: Send, scope: Scope, given: Given) -> None:
    """Have whoever wants this type the password first: a tab is led there and back, a program is told."""
    if "text/html" not in given.one("accept"):
        await _refuse(send, 403, "password-again")
        return
    to = scope["path"] if scope["method"] in SAFE else urlsplit(given.one("referer")).path
    query = urlencode({"again": "1", "to": to if to.startswith("/admin") else "/admin/"})
    headers: list[Any] = [(b"location", f"{_SIGN_IN}?{query}".encode()), *_HEADERS, (b"content-length", b"0")]
    await send({"type": "http.response.start", "status": 303, "headers": headers})
    await send({"type": "http.response.body", "body": b""})


async def _refuse(send: Send, status: int, slug: str) -> None:
    body = json.dumps({"type": f"/problems/{slug}", "status": status, "outcome": "not_done"}).encode()
    headers: list[Any] = [(b"content-type", b"application/problem+json"), *_HEADERS]
    headers.append((b"content-length", str(len(body)).encode()))
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
