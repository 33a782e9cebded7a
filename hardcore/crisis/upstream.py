"""Connections to one core: one request at a time each, kept open between requests, bounded in number.

A pool belongs to one life of a core (socket and epoch) and ends with it: closing the pool tells every
asker at once that no answer will come, before anything of a newer core is believed. Only a core that was drained
for a planned switch is retired instead: it has answered everything, and the last words may still be on their way. HTTP/1.1 with one
request per connection was chosen over pipelining to the core: one slow answer would hold up others, and
a death would make all of them doubtful.
"""

import asyncio
from collections.abc import Callable
from typing import Protocol, cast

import httptools

from hardcore.crisis.heads import AnswerHead, Header, read_answer

#: Bytes of an answer's head; the core says less, and something that is no core must not fill our memory.
HEAD_BYTES_MAX = 256 << 10


class Asker(Protocol):
    """Who asks the core something. Exactly one of `ended`, `lost`, `garbled` and `dropped` comes last."""

    def headed(self, head: AnswerHead) -> None:
        """The answer's head is here."""

    def came(self, data: bytes) -> None:
        """A piece of the answer's body is here."""

    def ended(self) -> None:
        """The answer is whole."""

    def lost(self) -> None:
        """The connection is gone; no answer will come."""

    def garbled(self) -> None:
        """What came is no answer that can be read."""

    def dropped(self) -> None:
        """Nobody waits for the answer any more. Nothing else comes."""

    def flowing(self, *, on: bool) -> None:
        """The core takes more of the request's body (`on`), or wants no more for now."""


class UpstreamConnection(asyncio.Protocol):
    """One connection to a core."""

    def __init__(self, pool: "Pool") -> None:
        self._pool = pool
        self._transport: asyncio.Transport | None = None
        self._parser = httptools.HttpResponseParser(self)
        self._asker: Asker | None = None
        self._no_body = False  # the request was a HEAD: the parser cannot know that no body follows
        self._request_sent = False
        self._reason = b""
        self._lines: list[Header] = []
        self._headed = False
        self._head_bytes = 0
        self.idle_since = 0.0

    # -- what the pool and the asker call --------------------------------------------------------------

    def ask(self, asker: Asker, data: bytes, *, no_body: bool, whole: bool) -> None:
        """Send a request. `whole`: its body is in `data` too; otherwise `send` and `finish` follow."""
        assert self._asker is None, "a connection carries one request at a time"
        assert self._transport is not None
        self._asker, self._no_body, self._request_sent = asker, no_body, whole
        self._head_bytes, self._headed = 0, False
        self._transport.write(data)

    def send(self, data: bytes) -> None:
        """Send a piece of the request's body."""
        assert self._transport is not None
        self._transport.write(data)

    def finish(self) -> None:
        """The request's body is whole."""
        self._request_sent = True

    def pause(self) -> None:
        """Let the answer wait: its reader is slow."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.pause_reading()

    def resume(self) -> None:
        """Let the answer flow again."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.resume_reading()

    def abandon(self) -> None:
        """Nobody waits for the answer any more: close."""
        asker, self._asker = self._asker, None
        self._end()
        if asker is not None:
            asker.dropped()

    def hang_up(self) -> None:
        """The core is not to be believed any more: close, and tell the asker that its answer is lost."""
        asker, self._asker = self._asker, None
        self._end()
        if asker is not None:
            asker.lost()

    @property
    def usable(self) -> bool:
        """Whether another request can be sent here."""
        return self._transport is not None and not self._transport.is_closing()

    def _end(self) -> None:
        if self._transport is not None:
            self._transport.abort()
        self._pool.forget(self)

    # -- asyncio ---------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the transport."""
        self._transport = cast("asyncio.Transport", transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """The core is gone, or closed an unused connection."""
        del exc  # why it ended makes no difference to whoever waits
        self.hang_up()

    def data_received(self, data: bytes) -> None:
        """Parse. An answer nobody asked for ends the connection."""
        if self._asker is None:
            self._end()
            return
        try:
            self._parser.feed_data(data)
        except httptools.HttpParserCallbackError as error:
            raise (error.__context__ or error) from None  # our own bug: the parser only wraps it
        except (httptools.HttpParserError, httptools.HttpParserUpgrade):
            self._garbled()
        if not self._headed:
            self._head_bytes += len(data)
            if self._head_bytes > HEAD_BYTES_MAX:
                self._garbled()

    def _garbled(self) -> None:
        asker, self._asker = self._asker, None
        self._end()
        if asker is not None:
            asker.garbled()

    def pause_writing(self) -> None:
        """The core reads slowly."""
        if self._asker is not None:
            self._asker.flowing(on=False)

    def resume_writing(self) -> None:
        """The core reads again."""
        if self._asker is not None:
            self._asker.flowing(on=True)

    # -- httptools -------------------------------------------------------------------------------------

    def on_message_begin(self) -> None:
        """A new head begins."""
        self._reason, self._lines, self._headed = b"", [], False

    def on_status(self, reason: bytes) -> None:
        """A piece of the reason phrase."""
        self._reason += reason

    def on_header(self, name: bytes, value: bytes) -> None:
        """A header line; after the body, a trailer, which nobody here has use for."""
        if not self._headed:
            self._lines.append((name, value))

    def on_headers_complete(self) -> None:
        """Take the head apart; interim answers (1xx) are passed over."""
        self._headed = True
        status = self._parser.get_status_code()
        if self._asker is None or 100 <= status < 200:
            return
        head = read_answer(status, self._reason, self._lines)
        if not head.framed and not self._no_body:
            # An answer that ends with its connection cannot be told from one that was cut by a death.
            self._garbled()
            return
        self._asker.headed(head)
        if self._no_body and not head.bodiless:
            self._done(reusable=False)

    def on_body(self, data: bytes) -> None:
        """A piece of the body."""
        if self._asker is not None:
            self._asker.came(data)

    def on_message_complete(self) -> None:
        """The answer is whole."""
        if self._asker is None or 100 <= self._parser.get_status_code() < 200:
            return
        self._done(reusable=self._parser.should_keep_alive() and self._request_sent)

    def _done(self, *, reusable: bool) -> None:
        asker, self._asker = self._asker, None
        assert asker is not None
        if not reusable:
            self._end()
        asker.ended()
        if reusable and self.usable:
            self.resume()  # the last piece of an answer may have found its reader slow
            self._pool.give_back(self)


class Pool:
    """The connections to one core. `freed` is called when a request could be sent that could not before."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        socket: str,
        epoch: int,
        *,
        connections_max: int,
        idle_ms: int,
        freed: Callable[[], None],
    ) -> None:
        self.epoch = epoch
        self._loop = loop
        self._socket = socket
        self._connections_max = connections_max
        self._idle_s = idle_ms / 1000
        self._freed = freed
        self._all: set[UpstreamConnection] = set()
        self._idle: list[UpstreamConnection] = []
        self._dials: set[asyncio.Task[None]] = set()
        self._closed = False

    def idle(self) -> UpstreamConnection | None:
        """An open connection that carries nothing, or None."""
        while self._idle:
            connection = self._idle.pop()
            fresh = self._loop.time() - connection.idle_since < self._idle_s
            if connection.usable and fresh:
                return connection
            connection.abandon()
        return None

    @property
    def room(self) -> bool:
        """Whether one more request can be sent now."""
        return bool(self._idle) or len(self._all) + len(self._dials) < self._connections_max

    def dial(self, then: Callable[[UpstreamConnection | None], None]) -> None:
        """Open a connection and hand it to `then`; None: the core refused, or the pool was closed."""
        task = self._loop.create_task(self._dial(then))
        self._dials.add(task)
        task.add_done_callback(self._dials.discard)

    async def _dial(self, then: Callable[[UpstreamConnection | None], None]) -> None:
        try:
            _, connection = await self._loop.create_unix_connection(
                lambda: UpstreamConnection(self), self._socket
            )
        except OSError:
            then(None)
            return
        if self._closed or not connection.usable:  # it may have ended before we were told that it began
            connection.abandon()
            then(None)
            return
        self._all.add(connection)
        then(connection)

    def warm(self, count: int) -> None:
        """Open connections before they are needed."""
        for _ in range(min(count, self._connections_max)):
            self.dial(lambda connection: self.give_back(connection) if connection is not None else None)

    def give_back(self, connection: UpstreamConnection) -> None:
        """A connection is free again."""
        if self._closed or len(self._all) > self._connections_max:
            connection.abandon()
            return
        connection.idle_since = self._loop.time()
        self._idle.append(connection)
        self._freed()

    def forget(self, connection: UpstreamConnection) -> None:
        """A connection is gone."""
        if connection in self._all:
            self._all.discard(connection)
            if connection in self._idle:
                self._idle.remove(connection)
            self._freed()

    def prune(self) -> None:
        """Close connections that were not used for a while, before the core does."""
        limit = self._loop.time() - self._idle_s
        for connection in [c for c in self._idle if c.idle_since < limit]:
            connection.abandon()

    def retire(self) -> None:
        """Ask this core nothing more, and hear what it still has to say."""
        self._closed = True
        for connection in list(self._idle):
            connection.abandon()

    def close(self) -> None:
        """Believe nothing of this core any more."""
        self._closed = True
        for connection in list(self._all):
            connection.hang_up()
