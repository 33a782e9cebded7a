"""A gateway that says what a test tells it to: the other side of the crisis script's wire (docs/wires.md, 9).

The real gateway shows what happens; this one can also stay in a moment for as long as somebody wants to look at
it, or say what no healthy gateway would. It serves the same files and pages, real sockets and all, and keeps no
state of its own but the last frame.
"""

import asyncio
import contextlib
import json
import threading
from collections.abc import Mapping
from http import HTTPStatus
from types import TracebackType
from typing import Any, Final, Self

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from frontend.crisis_paper import SOURCES, Kind, Outcome, Page, own_files, recovery_page
from frontend.render import Language

PAGE_POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
SERVING: Final[Mapping[str, Any]] = {
    "v": 1, "type": "state", "state": "OPERATIONAL", "phase": "RUNNING", "stage": None, "stages": 4,
    "since": None, "elapsed_ms": 0, "eta": None, "samples": 0, "incident": None, "held": 0, "planned": False,
    "alerted_at": None, "safe": None, "text": None, "sound": None,
}  # fmt: skip
_HELLO: Final = {"v": 1, "type": "hello", "overlay_after_ms": 400, "demo": False}
_START_S: Final = 10


def down(text: str = "R1", **fields: Any) -> dict[str, Any]:
    """A state frame of an outage."""
    first = {"state": "RECOVERY", "phase": "STARTING", "stage": 3, "text": text, "planned": text == "R2"}
    return {**SERVING, **first, **fields}


def back(outage_ms: int | None, *, verified: bool | None = None) -> dict[str, Any]:
    """What is said when a core serves again."""
    return {"v": 1, "type": "back", "outage_ms": outage_ms, "verified": verified, "planned": False}


class ScriptedGateway:
    """Serves `pages` (path -> HTML) with the crisis script in them, as long as the context lasts."""

    def __init__(self, pages: Mapping[str, str]) -> None:
        self.pages = dict(pages)
        self.recovering: tuple[Language, Kind, Outcome] | None = None
        self.refuses_sockets = False
        self.has_no_place = False
        self.asked: list[str] = []
        self.files: dict[str, tuple[bytes, str]] = {}  # what its pages load besides, and of which type
        self._state: Mapping[str, Any] = SERVING
        self._listeners: set[ServerConnection] = set()
        self._loop = asyncio.new_event_loop()
        self._ready = threading.Event()
        self._ended = asyncio.Event()
        self._awake = asyncio.Event()
        self._awake.set()
        self._thread = threading.Thread(target=self._run, name="scripted gateway")
        self.port = 0

    def __enter__(self) -> Self:
        self._thread.start()
        assert self._ready.wait(_START_S), "the scripted gateway did not start"
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.thaw()
        self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join(_START_S)

    @property
    def url(self) -> str:
        """Where it listens."""
        return f"http://127.0.0.1:{self.port}"

    @property
    def listeners(self) -> int:
        """How many pages listen."""
        return len(self._listeners)

    def say(self, frame: Mapping[str, Any]) -> None:
        """Tell every page, from any thread."""
        asyncio.run_coroutine_threadsafe(self._say(frame), self._loop).result(_START_S)

    def forget(self) -> None:
        """What was said last is over; nobody is told, and whoever comes next finds the ledger served."""
        self._state = SERVING

    def hang_up(self) -> None:
        """End every page's socket."""
        asyncio.run_coroutine_threadsafe(self._hang_up(), self._loop).result(_START_S)

    def freeze(self) -> None:
        """Keep every connection and answer nothing, as a process that the kernel has stopped."""
        self._loop.call_soon_threadsafe(self._awake.clear)

    def thaw(self) -> None:
        """Answer again."""
        self._loop.call_soon_threadsafe(self._awake.set)

    # -- the serving thread ----------------------------------------------------------------------------

    def _run(self) -> None:
        self._loop.run_until_complete(self._serve())
        self._loop.close()

    async def _serve(self) -> None:
        async with serve(
            self._listen, "127.0.0.1", 0, process_request=self._answer, close_timeout=1
        ) as server:
            self.port = _port_of(server)
            self._ready.set()
            await self._ended.wait()

    async def _listen(self, page: ServerConnection) -> None:
        if self.has_no_place:
            await page.close(1013)
            return
        await page.send(json.dumps(_HELLO))
        await page.send(json.dumps(self._state))
        self._listeners.add(page)
        with contextlib.suppress(ConnectionError):
            await page.wait_closed()
        self._listeners.discard(page)

    async def _say(self, frame: Mapping[str, Any]) -> None:
        if frame["type"] == "state":
            self._state = frame
        for page in list(self._listeners):
            await page.send(json.dumps(frame))

    async def _hang_up(self) -> None:
        for page in list(self._listeners):
            await page.close(1012)

    async def _answer(self, _: ServerConnection, request: Request) -> Response | None:
        await self._awake.wait()
        path = request.path.partition("?")[0]
        self.asked.append(path)
        if path == "/__hc/live":
            return (
                _response(b"", "text/plain", {}, HTTPStatus.SERVICE_UNAVAILABLE)
                if self.refuses_sockets
                else None
            )
        if path == "/__hc/status.json":
            return _response(json.dumps(self._state).encode(), "application/json", {})
        if path in own_files():
            one = own_files()[path]
            return _response(one.body, one.content_type, {"Cache-Control": "no-cache"})
        if path.startswith("/source/"):  # single modules, for tests of one of them
            body = (SOURCES / path.removeprefix("/source/")).read_bytes()
            return _response(body, "text/javascript", {})
        if self.recovering is not None:
            return _recovery(recovery_page(*self.recovering))
        if path in self.files:
            body, kind = self.files[path]
            return _response(body, kind, {})
        if path in self.pages:
            return _page(self.pages[path])
        return _response(b"", "text/plain", {}, HTTPStatus.NOT_FOUND)


def _port_of(server: Server) -> int:
    return int(next(iter(server.sockets)).getsockname()[1])


def _page(html: str) -> Response:
    script = '<script type="module" src="/__hc/client.js"></script></head>'
    body = html.replace("</head>", script, 1).encode()
    return _response(body, "text/html; charset=utf-8", {"Content-Security-Policy": PAGE_POLICY})


def _recovery(page: Page) -> Response:
    policy = (
        f"default-src 'none'; script-src '{page.script_hash}'; style-src '{page.style_hash}'; "
        "connect-src 'self'; img-src data:; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
    )
    headers = {"Content-Security-Policy": policy, "Cache-Control": "no-store", "Retry-After": "1"}
    return _response(page.body, "text/html; charset=utf-8", headers, HTTPStatus.SERVICE_UNAVAILABLE)


def _response(
    body: bytes, kind: str, more: Mapping[str, str], status: HTTPStatus = HTTPStatus.OK
) -> Response:
    headers = Headers({"Content-Type": kind, "Content-Length": str(len(body)), "Connection": "close", **more})
    return Response(status.value, status.phrase, headers, body)
