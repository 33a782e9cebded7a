"""The guest that every peer guards: this ledger's own application, on the same book, reading only.

It imports all that the guarded core imports and answers the same question from the same file, so a cold start costs
everybody the same. It only reads, which is a favour to the peers: two of them run it twice at once, and a ledger
that writes could not be (the second would fence the first off). Each answer names the process that gave it; a POST to
`/hang` puts the event loop to sleep for good. `uvicorn bench.peers.guest:app`; HARDCORE_DATA names the book.
"""

import os
import time
from pathlib import Path
from typing import Final

from starlette.datastructures import MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from core.guarded.recorder import NoRecorder
from core.imports.desk import Desk
from core.journal.store import LEDGER_FILE, open_reading
from core.service import Service, Unwritten
from core.settings import Settings
from core.web.app import make_app

PID_HEADER: Final = "x-guest-pid"
HANG_PATH: Final = "/hang"
HANG_S: Final = 3600


class Guest:
    """An ASGI application. The book is opened at the first request: a parent that only forks must not have it open."""

    def __init__(self) -> None:
        self._app: ASGIApp | None = None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, and say who did."""
        if scope["type"] != "http":
            return
        if scope["path"] == HANG_PATH:
            await PlainTextResponse("hanging")(scope, receive, send)
            time.sleep(HANG_S)  # noqa: ASYNC251  # this is the fault: nothing runs on this loop any more
        if self._app is None:
            self._app = _ledger()

        async def signed(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message)[PID_HEADER] = str(os.getpid())
            await send(message)

        await self._app(scope, receive, signed)


def _ledger() -> ASGIApp:
    data, settings, recorder = Path(os.environ["HARDCORE_DATA"]), Settings(), NoRecorder()
    readers = open_reading(data / LEDGER_FILE, settings.readers + 1, settings.write_busy_ms)
    service = Service(Unwritten(0), readers, recorder, settings, 1, "DISK_READ_ONLY")
    return make_app(service, Desk(service, recorder, data))


app = Guest()
