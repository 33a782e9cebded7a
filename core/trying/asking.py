"""One request to a throw-away core, by hand: taken on a step at a time by whoever watches the core meanwhile.

A library's client would wait for its answer, and a core that hangs, grows or dies has to be seen while one waits; a thread
for it can't be had, because cores are forked here. The request is sent as it came but for what belongs to a connection,
and the connection ends with its answer.
"""

import http.client
import io
import json
import socket
from collections.abc import Iterable
from contextlib import suppress
from typing import Any, Final, cast
from urllib.parse import quote

import msgspec

from core.trying.docket import Request

ANSWER_BYTES_MAX: Final = 1 << 20
JSON_BYTES_MAX: Final = 64 << 10  # of an answer that is told on
_READ_BYTES: Final = 64 << 10
# They say something of a connection that is long gone, or of a body that is sent whole now.
_DROPPED: Final = frozenset(
    {
        "connection",
        "content-length",
        "expect",
        "host",
        "keep-alive",
        "proxy-connection",
        "te",
        "trailer",
        "transfer-encoding",
        "upgrade",
    }
)


class Reply(msgspec.Struct, frozen=True):
    """What a core answered; `answer` is its JSON, None where it is none or too much."""

    status: int
    answer: Any
    draining: bool = False


class Lost:
    """The connection ended without a whole answer."""


def sent_of(request: Request) -> bytes:
    """Return the bytes of a request, as they go through the socket."""
    kept = [(name, value) for name, value in request.headers if name.lower() not in _DROPPED]
    host = next((value for name, value in request.headers if name.lower() == "host"), "core")
    own = [("host", host), ("connection", "close"), ("content-length", str(len(request.body)))]
    head = [f"{request.method} {request.path} HTTP/1.1", *_lines(own), *_lines(kept), "", ""]
    return "\r\n".join(head).encode("latin-1") + request.body


def asking_for(key: str) -> bytes:
    """Return the bytes of the question what became of a key."""
    return sent_of(Request("GET", f"/api/ledger/commands/{quote(key, safe='', encoding='latin-1')}"))


def _lines(headers: Iterable[tuple[str, str]]) -> list[str]:
    return [f"{name}: {value}" for name, value in headers]


class Exchange:
    """One request on a connection of its own. `socket` is to be polled while `is_sending` for writing, then for reading."""

    def __init__(self, address: str, sent: bytes) -> None:
        """Connect to a core that listens, which a Unix socket does at once. OSError where it does not."""
        self.socket = socket.socket(socket.AF_UNIX)
        try:
            self.socket.connect(address)
        except OSError:
            self.socket.close()
            raise
        self.socket.setblocking(False)
        self._left = memoryview(sent)
        self._read = bytearray()

    @property
    def is_sending(self) -> bool:
        """Whether some of the request has not been taken yet."""
        return len(self._left) > 0

    def step(self) -> Reply | Lost | None:
        """Go on as far as that is possible without waiting; return what came of it, None where it goes on."""
        try:
            while self.is_sending:
                self._left = self._left[self.socket.send(self._left) :]
            while chunk := self.socket.recv(_READ_BYTES):
                self._read += chunk[: max(0, ANSWER_BYTES_MAX - len(self._read))]
        except BlockingIOError:
            return None
        except OSError:
            # It may have answered and hung up before it had read everything.
            self._left = self._left[:0]
            return _reply(bytes(self._read))
        return _reply(bytes(self._read))

    def close(self) -> None:
        """Hang up."""
        self.socket.close()


class _Read:
    """Bytes in a socket's place, for the standard library's reader of answers."""

    def __init__(self, raw: bytes) -> None:
        self._raw = raw

    def makefile(self, _mode: str) -> io.BytesIO:
        return io.BytesIO(self._raw)


def _reply(raw: bytes) -> Reply | Lost:
    response = http.client.HTTPResponse(cast("socket.socket", _Read(raw)))
    try:
        response.begin()
        body = response.read(JSON_BYTES_MAX + 1)
    except (http.client.HTTPException, OSError, ValueError):
        return Lost()
    answer = None
    if "json" in (response.getheader("content-type") or "") and len(body) <= JSON_BYTES_MAX:
        with suppress(ValueError, RecursionError):
            answer = json.loads(body)
    return Reply(response.status, answer, response.getheader("x-core-draining") is not None)
