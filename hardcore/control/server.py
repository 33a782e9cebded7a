"""The sentinel's side of the control socket: answers questions, feeds subscribers.

A subscriber that reads too slowly is cut off, not waited for: it comes back and gets the present state
whole, which is all it needs. Nothing a client sends can stop the loop; every line has a bound.
"""

import asyncio
import os
import socket
import struct
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path

from hardcore.control.protocol import (
    LINE_BYTES_MAX,
    Ask,
    BadRequest,
    Request,
    read_object,
    read_request,
    write_line,
)

BACKLOG_BYTES_MAX = 1 << 20
SUBSCRIBERS_MAX = 16
CLIENT_TIMEOUT_S = 30.0

#: Answers a question; the descriptors it names are sent along.
Answerer = Callable[[Request], Awaitable[tuple[Mapping[str, object], list[int]]]]
#: Takes in a line from a subscriber.
Listener = Callable[[dict[str, object]], None]
#: Returns the lines a new subscriber begins with.
Greeter = Callable[[], list[Mapping[str, object]]]
#: Is told which process has subscribed, as the kernel names it.
Doorman = Callable[[int], None]
_PEER = struct.Struct("3i")  # pid, uid, gid


class ControlServer:
    """Listens on one Unix socket for the operator and for the gateway."""

    def __init__(
        self,
        path: Path,
        answer: Answerer,
        listen: Listener,
        greet: Greeter,
        subscribed: Doorman = lambda _pid: None,
    ) -> None:
        self._path = path
        self._subscribed = subscribed
        self._answer = answer
        self._listen = listen
        self._greet = greet
        self._server: asyncio.Server | None = None
        self._subscribers: set[asyncio.StreamWriter] = set()

    async def start(self) -> None:
        """Bind and listen. The old path is ours to remove: we hold the sentinel's lock."""
        self._path.unlink(missing_ok=True)
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC)
        before = os.umask(0o177)
        try:
            listener.bind(str(self._path))
        finally:
            os.umask(before)
        self._server = await asyncio.start_unix_server(self._serve, sock=listener, limit=LINE_BYTES_MAX)

    def close(self) -> None:
        """Stop listening and let the subscribers go."""
        if self._server is not None:
            self._server.close()
        for writer in self._subscribers:
            writer.close()
        self._path.unlink(missing_ok=True)

    def publish(self, line: Mapping[str, object]) -> None:
        """Send a line to every subscriber."""
        data = write_line(line)
        for writer in tuple(self._subscribers):
            if writer.transport.get_write_buffer_size() > BACKLOG_BYTES_MAX:
                self._subscribers.discard(writer)
                writer.transport.abort()
                continue
            writer.write(data)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            line = await asyncio.wait_for(reader.readline(), CLIENT_TIMEOUT_S)
            if not line:
                return
            request = read_request(line)
            if isinstance(request, Request) and request.ask is Ask.SUBSCRIBE:
                await self._feed(reader, writer)
            else:
                await self._reply(request, writer)
        except (OSError, ValueError, TimeoutError):
            return  # the client is gone, or sent more than a line may hold
        except asyncio.CancelledError:
            return  # the guard ends: asyncio's streams would make a fault of the loop of it
        finally:
            writer.close()

    async def _reply(self, request: Request | BadRequest, writer: asyncio.StreamWriter) -> None:
        fds: list[int] = []
        answer: Mapping[str, object]
        if isinstance(request, BadRequest):
            answer = {"ok": False, "code": request.code, "error": request.error}
        else:
            answer, fds = await self._answer(request)
        if fds:
            _send_fds(writer, answer, fds)
            return
        writer.write(write_line(answer))
        await asyncio.wait_for(writer.drain(), CLIENT_TIMEOUT_S)

    async def _feed(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if len(self._subscribers) >= SUBSCRIBERS_MAX:
            writer.write(write_line({"ok": False, "code": "full", "error": "too many subscribers"}))
            return
        for line in self._greet():
            writer.write(write_line(line))
        self._subscribers.add(writer)
        self._subscribed(_peer(writer))
        try:
            while data := await reader.readline():
                value = read_object(data)
                if not isinstance(value, BadRequest):
                    self._listen(value)
        finally:
            self._subscribers.discard(writer)


def _peer(writer: asyncio.StreamWriter) -> int:
    """Return the process at the other end; what it says of itself could be anybody's."""
    raw = writer.get_extra_info("socket").getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size)
    return int(_PEER.unpack(raw)[0])


def _send_fds(writer: asyncio.StreamWriter, answer: Mapping[str, object], fds: list[int]) -> None:
    """Send a short answer with descriptors beside it; asyncio's transports can't, so a copy of the socket does."""
    transport_socket = writer.get_extra_info("socket")
    with socket.socket(fileno=os.dup(transport_socket.fileno())) as plain:
        socket.send_fds(plain, [write_line(answer)], fds)
