"""Listening: the socket of this life, and the HTTP server behind it.

Each life binds a socket of its own before it says READY; a listening socket shared between lives was tried,
and a thawed old core took half of the connections and answered from the past. The server is uvicorn with its
hands tied: signals, access log and shutdown belong to the core.
"""

import asyncio
import contextlib
import importlib
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, cast

from starlette.types import ASGIApp
from uvicorn.config import LIFESPAN, Config
from uvicorn.importer import import_from_string
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol
from uvicorn.server import Server

_LIFESPAN: Final = "off"
# The server would do so when it begins to listen, and somebody waits.
import_from_string(LIFESPAN[_LIFESPAN])
KEEP_ALIVE_S: Final = 3_600  # longer than a gateway keeps an idle connection: the side that asks closes first
CLOSING_S: Final = 1
TICK_S: Final = 1.0
# A page's socket: it says nothing, so it may say little; whoever is there answers a ping.
SAID_BYTES_MAX: Final = 4_096
PING_EVERY_S: Final = 20.0
PONG_WITHIN_S: Final = 20.0
#: Loaded behind the serving: its library is a third of what a start loads for the server, and no answer needs it.
PAGE_SOCKET: Final = "core.page_socket"


def bind_unix(path: Path) -> socket.socket | str:
    """Bind this life's own socket, for its owner alone; not listening yet. A sentence where it can't be had."""
    bound = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        bound.bind(str(path))
        path.chmod(0o600)
    except OSError as error:
        bound.close()
        return f"The socket {path} can't be bound ({error.strerror}): name another one in HARDCORE_SOCKET."
    return bound


def bind_loopback(port: int) -> socket.socket | str:
    """Bind a port on loopback; not listening yet. A sentence where it can't be had."""
    bound = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind(("127.0.0.1", port))
    except OSError as error:
        bound.close()
        return f"Port {port} on 127.0.0.1 can't be had ({error.strerror}): choose another one with --port."
    return bound


def _page_socket(**parts: Any) -> asyncio.Protocol:
    """Take the place of a class of sockets, whose code nobody has waited for at the start."""
    made: asyncio.Protocol = importlib.import_module(PAGE_SOCKET).PageSocket(**parts)
    return made


class LedgerServer(Server):
    """Serves one application on one bound socket."""

    def __init__(self, app: ASGIApp) -> None:
        super().__init__(
            Config(
                app,
                http=HttpToolsProtocol,
                ws=cast("type[asyncio.Protocol]", _page_socket),
                ws_max_size=SAID_BYTES_MAX,
                ws_per_message_deflate=False,
                ws_ping_interval=PING_EVERY_S,
                ws_ping_timeout=PONG_WITHIN_S,
                lifespan=_LIFESPAN,
                log_config=None,
                access_log=False,
                proxy_headers=False,
                server_header=False,
                timeout_keep_alive=KEEP_ALIVE_S,
                timeout_graceful_shutdown=CLOSING_S,
            )
        )
        self._listening = asyncio.Event()
        self._leaving = asyncio.Event()
        self._serving: asyncio.Task[None] | None = None

    async def start(self, bound: socket.socket) -> None:
        """Listen; returns once connections are taken."""
        self._serving = asyncio.create_task(self.serve([bound]))
        listening = asyncio.create_task(self._listening.wait())
        await asyncio.wait({self._serving, listening}, return_when=asyncio.FIRST_COMPLETED)
        listening.cancel()
        if self._serving.done():
            self._serving.result()  # raises what kept it from listening
        assert self._listening.is_set()

    async def stop(self) -> None:
        """Take no more connections, close the idle ones, and end."""
        assert self._serving is not None
        self._leaving.set()
        await self._serving

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start as the server does, and say when it has."""
        await super().startup(sockets)
        self._listening.set()

    async def main_loop(self) -> None:
        """Renew the Date header once a second until asked to leave."""
        while not self._leaving.is_set():
            await self.on_tick(0)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._leaving.wait(), TICK_S)

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave the signals alone: the core hears them."""
        yield
