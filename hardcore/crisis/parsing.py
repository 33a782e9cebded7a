"""Bytes of a client's connection, cut into requests: head, body, end.

A thin coat over httptools (llhttp in its strict mode, which refuses bare LF, folded lines and a length
said twice) that adds what it leaves open: the size of a head, the judgement of `heads`, and silence after
the first fault, because what follows a request that could not be read is not a request.
"""

from collections.abc import Collection
from typing import Protocol

import httptools

from hardcore.crisis.heads import Header, RequestHead, read_request
from hardcore.crisis.problems import Problem


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


class RequestParser:
    """Parses one connection's requests."""

    def __init__(self, listener: Listener, hosts: Collection[str], header_bytes_max: int) -> None:
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

    def feed(self, data: bytes) -> None:
        """Parse `data`; everything found is told to the listener before this returns."""
        try:
            self._parser.feed_data(data)
        except httptools.HttpParserCallbackError as error:
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

    def on_url(self, target: bytes) -> None:
        """A piece of the target."""
        self._target += target

    def on_header(self, name: bytes, value: bytes) -> None:
        """A header line; after the head, a trailer, which nobody here has use for."""
        if self.in_head:
            self._lines.append((name, value))

    def on_headers_complete(self) -> None:
        """Judge the head."""
        self.in_head = False
        if self.deaf:
            return
        size = len(self._target) + sum(len(name) + len(value) + 4 for name, value in self._lines)
        if size > self._header_bytes_max:
            self.refuse(Problem.HEAD_TOO_LARGE)
            return
        parser = self._parser
        method = parser.get_method().decode()
        head = read_request(
            method,
            self._target,
            parser.get_http_version(),
            self._lines,
            self._hosts,
            keep_alive=parser.should_keep_alive(),
            upgrade=parser.should_upgrade(),
        )
        if isinstance(head, Problem):
            tongue = next((v for n, v in self._lines if n.lower() == b"accept-language"), b"")
            self.refuse(head, tongue.decode("latin-1"), no_body=method == "HEAD")
            return
        self._in_body = True
        self._listener.headed(head)

    def on_body(self, data: bytes) -> None:
        """A piece of the body."""
        if self._in_body and not self.deaf:
            self._listener.came(data)

    def on_message_complete(self) -> None:
        """The request is whole."""
        if self._in_body and not self.deaf:
            self._in_body = False
            self._listener.whole()
