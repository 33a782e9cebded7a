"""The browser's end of a WebSocket: taken over from its HTTP connection, bounded, kept alive, seen to its end.

The handshake was judged with the request's head; what is answered comes from the library's protocol, which does
no input or output of its own. Everything it may cost has a bound, alone and together with all others (`burden`):
a message, what it leaves unread; the time it takes to close, and the time it says nothing at all (it is asked, because a laptop that was closed says nothing).
"""

import asyncio
from collections.abc import Callable
from typing import Protocol, cast

from websockets.datastructures import Headers
from websockets.http11 import Request
from websockets.protocol import State
from websockets.server import ServerProtocol
from websockets.typing import Subprotocol

from hardcore.crisis.alarm import Alarm
from hardcore.crisis.burden import Burden
from hardcore.crisis.census import Census, address_of
from hardcore.crisis.heads import RequestHead, answer_bytes, browser_of
from hardcore.crisis.lifeline import TRY_LATER
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.messages import PING, SILENT, Message, Messages
from hardcore.crisis.mishap import contained
from hardcore.crisis.pages import Answer

#: So much may wait to be sent to a socket without being counted: most have read what there is to read.
UNCOUNTED_BYTES = 16 << 10


class Party(Protocol):
    """Who speaks with the browser."""

    def said(self, message: Message) -> None:
        """The browser said something."""

    def left(self, code: int | None) -> None:
        """The browser's end is gone; `code` if it said one. Comes once, and last."""

    def leaves(self) -> None:
        """The gateway leaves."""


class BrowserSocket(asyncio.Protocol):
    """One browser's socket. Unanswered until `accept` or `refuse`."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        transport: asyncio.Transport,
        head: RequestHead,
        census: Census,
        limits: GatewayLimits,
        burden: Burden,
    ) -> None:
        self.head = head
        self.browser = browser_of(head.cookie)
        self.party: Party | None = None
        self.gone: list[Callable[[BrowserSocket], None]] = []  # called when it is gone, after its party
        self._transport = transport
        self._census = census
        self._limits = limits
        self._ws: ServerProtocol | None = None
        self._messages = Messages()
        self._unfinished = burden.share()
        self._unsent = burden.share()
        self._ending = Alarm(loop, self.cut)
        self._ends = False  # our last bytes were written
        self._heard = True  # since it was asked last
        self._slowed = False  # what it says is not read for now
        census.enter(self, address_of(transport))
        # Reading stops meanwhile: the loop takes up another kind of protocol only when it begins to read.
        transport.pause_reading()
        transport.set_protocol(self)
        transport.set_write_buffer_limits(high=UNCOUNTED_BYTES)
        transport.resume_reading()

    # -- what its party calls --------------------------------------------------------------------------

    @property
    def open(self) -> bool:
        """Whether it can be said something."""
        return self._ws is not None and self._ws.state is State.OPEN and not self._transport.is_closing()

    def accept(self, subprotocol: str | None, *, bytes_max: int) -> None:
        """Answer the handshake. `bytes_max`: the longest message it may say."""
        handshake = self.head.handshake
        assert handshake is not None, "only a handshake is handed over"
        asked = Headers(
            {
                "Connection": "Upgrade",
                "Upgrade": "websocket",
                "Sec-WebSocket-Key": handshake.key,
                "Sec-WebSocket-Version": "13",
            }
        )
        spoken = [Subprotocol(subprotocol)] if subprotocol is not None else None
        if subprotocol is not None:
            asked["Sec-WebSocket-Protocol"] = subprotocol
        ws = ServerProtocol(subprotocols=spoken, max_size=bytes_max, logger=SILENT)
        # Said to the library in our own words: nothing it reads was written by a client.
        ws.receive_data(Request("/", asked).serialize())
        answer = ws.accept(cast("Request", ws.events_received()[0]))
        assert answer.status_code == 101, "a handshake that was judged is accepted"
        ws.send_response(answer)
        self._ws = ws
        self._flush()

    def refuse(self, answer: Answer) -> None:
        """Answer with something else than a socket."""
        if self._ws is not None or self._ends or self._transport.is_closing():
            return
        length = None if answer.head.bodiless else len(answer.body)
        said = answer_bytes(answer.head, length=length, chunked=False, close=True, http10=False)
        self._transport.write(said + answer.body)
        self._end()

    def send(self, frame: bytes) -> None:
        """Write a frame, unless it is ending; one that reads too slowly is ended."""
        if not self.open:
            return
        waiting = self._transport.get_write_buffer_size()
        if waiting > self._limits.socket_unsent_bytes_max or (
            waiting > UNCOUNTED_BYTES and not self._unsent.weighs(waiting + len(frame))
        ):
            self.close(TRY_LATER, "read faster")
            return
        self._transport.write(frame)

    def close(self, code: int, reason: str = "") -> None:
        """Say that it is over."""
        if self.open and self._ws is not None:
            self._ws.send_close(code, reason)
            self._flush()
            self._ending.set(self._limits.socket_close_ms)

    def ask(self) -> None:
        """Ask whether somebody is still there; whoever said nothing since the last time is not."""
        if self._slowed:
            return  # its answer would not be read
        if not self._heard:
            self.cut()
        elif self.open:
            self._heard = False
            self.send(PING)

    def slow_down(self, *, on: bool) -> None:
        """Let the browser wait with what it says, or go on."""
        if self._transport.is_closing():
            return
        if on:
            self._transport.pause_reading()
        elif self._slowed:
            self._heard = True
            self._transport.resume_reading()
        self._slowed = on

    def depart(self) -> None:
        """The gateway leaves. Said again, there is no more time."""
        if self._ends or (self._ws is not None and not self.open):
            self.cut()
        elif self.party is not None:
            self.party.leaves()

    # -- asyncio ---------------------------------------------------------------------------------------

    def data_received(self, data: bytes) -> None:
        """Take in what the browser says. Before it was answered it has nothing to say."""
        self._heard = True
        if self._ends:
            return
        if self._ws is None or not contained("a browser's socket", lambda: self._take_in(data)):
            self.cut()

    def _take_in(self, data: bytes) -> None:
        assert self._ws is not None, "what is said before the answer is not taken in"
        self._ws.receive_data(data)
        events = self._ws.events_received()
        self._flush()
        for message in self._messages.take(len(data), events):
            if self.party is not None:
                self.party.said(message)
        if not self._unfinished.weighs(self._messages.unfinished_bytes):
            self.close(TRY_LATER, "too much at a time")

    def eof_received(self) -> bool:
        """The browser says no more: a WebSocket is over with that."""
        return False

    def pause_writing(self) -> None:
        """It reads slowly: what waits for it counts."""
        self._unsent.weighs(self._transport.get_write_buffer_size())

    def resume_writing(self) -> None:
        """It has caught up."""
        self._unsent.weighs(0)

    def connection_lost(self, exc: Exception | None) -> None:
        """It is gone."""
        del exc  # why a browser left makes no difference
        self._ending.close()
        self._unfinished.weighs(0)
        self._unsent.weighs(0)
        self._census.leave(self)
        party, self.party = self.party, None
        if party is not None:
            said = self._ws.close_rcvd if self._ws is not None else None
            party.left(said.code if said is not None else None)
        for forget in self.gone:
            forget(self)

    # -- its end ---------------------------------------------------------------------------------------

    def _flush(self) -> None:
        assert self._ws is not None
        over = False
        for data in self._ws.data_to_send():
            if data:
                self._transport.write(data)
            else:
                over = True
        if over:
            self._end()
            return
        waiting = self._transport.get_write_buffer_size()
        if waiting > 2 * self._limits.socket_unsent_bytes_max or (
            waiting > UNCOUNTED_BYTES and not self._unsent.weighs(waiting)
        ):
            self.cut()  # it asks and asks, and reads none of our answers

    def _end(self) -> None:
        """End after what was written. Whoever still speaks is heard out: a reset would overtake our words."""
        if self._ends or self._transport.is_closing():
            return
        self._ends = True
        if self._transport.can_write_eof():
            self._transport.write_eof()
        self._transport.resume_reading()
        self._ending.set(self._limits.socket_close_ms)

    def cut(self) -> None:
        """End it at once."""
        self._transport.abort()
