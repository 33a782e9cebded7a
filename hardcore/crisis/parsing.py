"""Bytes of a client's connection, cut into requests: head, body, end.

A thin coat over httptools (llhttp in its strict mode, which refuses bare LF, folded lines and a length
said twice) that adds what it leaves open: the size of a head, the judgement of `heads`, and silence after
the first fault, because what follows a request that could not be read is not a request.

Clients say the same lines with nearly every request of a connection. What was judged once is not judged again: lines
that are equal byte for byte, as this parser cut them, lead to the same judgement. Bytes before the parser are never
compared, because that would be a second parser.
"""

from collections.abc import Collection
from typing import Protocol

import httptools
import msgspec

from hardcore.crisis.heads import Header, RequestHead, read_request, with_target
from hardcore.crisis.problems import Problem
from hardcore.crisis.recording import NOBODYS, Recording

#: Header lines up to this size are remembered as judged, those of one head for each connection.
REMEMBERED_BYTES_MAX = 4 << 10


class Listener(Protocol):
    """Who is told what was parsed."""

    def headed(self, head: RequestHead) -> None:
        """A head is whole and fit to be served."""

    def refused(self, problem: Problem, accept_language: str, *, no_body: bool) -> None:
        """A head is whole (or never will be) and cannot be served. Nothing more follows."""

    def came(self, data: bytes) -> None:
        """A piece of the body."""

    def whole(self) -> None:
        """The body is at its end."""


class _Judged(msgspec.Struct, frozen=True):
    """The last head of a connection, and what it was judged from."""

    method: bytes
    version: str
    lines: list[Header]
    lines_bytes: int
    head: RequestHead


class _RefusedPathError(Exception):
    """The head that is being parsed is for a path that is refused. Raised within the parser, to stop it there."""


class RequestParser:
    """Parses one connection's requests; `place` is where the one that is being parsed stands in the `recording`."""

    def __init__(
        self,
        listener: Listener,
        hosts: Collection[str],
        header_bytes_max: int,
        recording: Recording = NOBODYS,
    ) -> None:
        self.place = recording.no_place
        self._recording = recording
        self._connection = recording.connection()
        self._fed = b""
        self.in_head = False
        self.deaf = False
        self.overrun = False  # the client spoke on in another protocol before it was told to
        self._listener = listener
        self._hosts = hosts
        self._header_bytes_max = header_bytes_max
        self._parser = httptools.HttpRequestParser(self)
        self._in_body = False
        self._head_bytes = 0
        self._target = b""
        self._lines: list[Header] = []
        self._judged: _Judged | None = None

    def feed(self, data: bytes) -> None:
        """Parse `data`; everything found is told to the listener before this returns."""
        self.place.heard(len(data))
        self._fed = data
        try:
            self._parser.feed_data(data)
        except httptools.HttpParserCallbackError as error:
            if isinstance(error.__context__, _RefusedPathError):
                self.refuse(Problem.REFUSED_PATH)
                return
            raise (error.__context__ or error) from None  # our own bug: the parser only wraps it
        except httptools.HttpParserUpgrade as upgrade:
            self.deaf = True  # what follows would be another protocol, which is not spoken here
            self.overrun = len(data) > upgrade.args[0]
        except httptools.HttpParserInvalidMethodError:
            self.refuse(Problem.METHOD_NOT_ALLOWED)
        except httptools.HttpParserError:
            self.refuse(Problem.BAD_REQUEST)
        if self.in_head and not self.deaf:
            self._head_bytes += len(data)
            if self._head_bytes > self._header_bytes_max:
                self.refuse(Problem.HEAD_TOO_LARGE)

    def refuse(self, problem: Problem, accept_language: str = "", *, no_body: bool = False) -> None:
        """Refuse what is being parsed; nothing more is listened to."""
        if not self.deaf:
            self.deaf = True
            self._listener.refused(problem, accept_language, no_body=no_body)

    # -- httptools -------------------------------------------------------------------------------------

    def on_message_begin(self) -> None:
        """A new head begins."""
        self.in_head, self._head_bytes, self._target, self._lines = True, 0, b"", []
        self.place = self._recording.take(self._connection)
        self.place.heard(len(self._fed))

    def on_url(self, target: bytes) -> None:
        """A piece of the target."""
        self._target += target
        name = self._name()
        self.place.named(name)
        # What ends where our bytes end may go on: then it is judged with its head.
        if self._recording.refused and not self._fed.endswith(target) and self._recording.refuses(name):
            raise _RefusedPathError

    def _name(self) -> int:
        return self._recording.name_of(self._parser.get_method(), self._target)

    def on_header(self, name: bytes, value: bytes) -> None:
        """A header line; after the head, a trailer, which nobody here has use for."""
        if self.in_head:
            self._lines.append((name, value))

    def on_headers_complete(self) -> None:
        """Judge the head."""
        self.in_head = False
        if self.deaf:
            return
        if self._recording.refused and self._recording.refuses(self._name()):
            self.refuse(Problem.REFUSED_PATH)
            return
        head = self._judge()
        if isinstance(head, Problem):
            tongue = next((v for n, v in self._lines if n.lower() == b"accept-language"), b"")
            no_body = self._parser.get_method() == b"HEAD"
            self.refuse(head, tongue.decode("latin-1"), no_body=no_body)
            return
        self._in_body = True
        self._listener.headed(head)

    def _judge(self) -> RequestHead | Problem:
        parser, lines, target = self._parser, self._lines, self._target
        method, version = parser.get_method(), parser.get_http_version()
        last = self._judged
        if last is not None and last.lines == lines and (last.method, last.version) == (method, version):
            again = with_target(last.head, target)
            if again is not None and last.lines_bytes + len(target) <= self._header_bytes_max:
                return again
        lines_bytes = sum(len(name) + len(value) + 4 for name, value in lines)
        if lines_bytes + len(target) > self._header_bytes_max:
            return Problem.HEAD_TOO_LARGE
        keep_alive, upgrade = parser.should_keep_alive(), parser.should_upgrade()
        head = read_request(
            method.decode(), target, version, lines, self._hosts, keep_alive=keep_alive, upgrade=upgrade
        )
        self._judged = None
        if isinstance(head, RequestHead) and lines_bytes <= REMEMBERED_BYTES_MAX:
            self._judged = _Judged(method, version, lines, lines_bytes, head)
        return head

    def on_body(self, data: bytes) -> None:
        """A piece of the body."""
        if self._in_body and not self.deaf:
            self._listener.came(data)

    def on_message_complete(self) -> None:
        """The request is whole."""
        if self._in_body and not self.deaf:
            self._in_body = False
            self._listener.whole()
