"""The core's end of a WebSocket: asked for in the browser's name, believed only if it is the core that was named.

The request is written anew from what was judged, without extensions, so that what two parsers might read
differently does not reach the core. One connection is one socket: nothing here is used twice.
"""

import asyncio
from typing import Protocol, cast

import msgspec
from websockets.client import ClientProtocol
from websockets.datastructures import Headers
from websockets.http11 import Request, Response
from websockets.protocol import State
from websockets.typing import Subprotocol
from websockets.uri import WebSocketURI

from hardcore.crisis.burden import Burden
from hardcore.crisis.heads import AnswerHead, RequestHead, read_answer
from hardcore.crisis.lifeline import TRY_LATER
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.messages import SILENT, Message, Messages
from hardcore.crisis.mishap import contained
from hardcore.crisis.pages import Answer

#: The core's end failed in a way that has no other name.
FAILED = 1011
#: More unsent than this, and the browser has to wait with what it says.
_WRITE_HIGH_BYTES = 64 << 10
_ANYWHERE = WebSocketURI(secure=False, host="localhost", port=80, path="/", query="")


class Accepted(msgspec.Struct, frozen=True):
    """The core opened its end."""

    head: AnswerHead


class Declined(msgspec.Struct, frozen=True):
    """The core answered with something else. Nothing more comes."""

    answer: Answer


class Broken(msgspec.Struct, frozen=True):
    """What came is no answer. Nothing more comes."""


class Told(msgspec.Struct, frozen=True):
    """The core said something."""

    message: Message


class Closed(msgspec.Struct, frozen=True):
    """The core said that the socket is over. Nothing more comes."""

    code: int


class Lost(msgspec.Struct, frozen=True):
    """The connection is gone. Nothing more comes."""


class NotTaken(msgspec.Struct, frozen=True):
    """There never was a connection. Nothing more comes."""


Fact = Accepted | Declined | Broken | Told | Closed | Lost | NotTaken


class CoreParty(Protocol):
    """Who asked for the socket."""

    def learn(self, core: "CoreSocket", fact: Fact) -> None:
        """Something happened at the core's end."""

    def flowing(self, core: "CoreSocket", *, on: bool) -> None:
        """The core takes more (`on`), or wants no more for now."""


class CoreSocket(asyncio.Protocol):
    """One socket at one core."""

    def __init__(
        self,
        head: RequestHead,
        target: bytes,
        epoch: int,
        limits: GatewayLimits,
        burden: Burden,
        party: CoreParty,
    ) -> None:
        assert head.handshake is not None, "only a handshake is passed on"
        self.epoch = epoch
        self._head = head
        self._target = target
        self._party: CoreParty | None = party
        self._transport: asyncio.Transport | None = None
        names = [Subprotocol(name) for name in head.handshake.protocols]
        self._ws = ClientProtocol(
            _ANYWHERE, subprotocols=names or None, max_size=limits.socket_message_bytes_max, logger=SILENT
        )
        self._messages = Messages()
        self._unfinished = burden.share()
        self._unsent = burden.share()

    @property
    def subprotocol(self) -> str | None:
        """What the core chose to speak."""
        return self._ws.subprotocol

    # -- what its party calls --------------------------------------------------------------------------

    def say(self, message: Message) -> None:
        """Pass a message on to the core."""
        if self._ws.state is State.OPEN:
            if message.text:
                self._ws.send_text(message.data)
            else:
                self._ws.send_binary(message.data)
            self._flush()

    def leave(self, code: int) -> None:
        """The browser's end is gone, or this core is not to be believed any more: close, and tell nobody."""
        self._party = None
        if self._transport is None:
            return
        if self._ws.state is State.OPEN:
            self._ws.send_close(code)
            self._flush()
        if self._transport is not None:
            self._transport.close()

    # -- asyncio ---------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Ask."""
        self._transport = cast("asyncio.Transport", transport)
        if self._party is None:  # nobody waits for it any more
            self._transport.close()
            return
        self._transport.set_write_buffer_limits(high=_WRITE_HIGH_BYTES)
        request = self._ws.connect()
        self._ws.send_request(Request(self._target.decode("ascii"), self._headers(request.headers)))
        self._flush()

    def _headers(self, ours: Headers) -> Headers:
        """The library's own headers, and the browser's that go on to a core."""
        del ours["Host"]
        ours["Host"] = self._head.host.decode("latin-1")
        for name, value in self._head.headers:
            ours[name.decode("latin-1")] = value.decode("latin-1")
        return ours

    def data_received(self, data: bytes) -> None:
        """Judge the answer, then pass on what the core says."""
        if not contained("a core's socket", lambda: self._take_in(data)) and self._transport is not None:
            self._transport.abort()

    def _take_in(self, data: bytes) -> None:
        self._ws.receive_data(data)
        events = self._ws.events_received()
        self._flush()
        answer = next((event for event in events if isinstance(event, Response)), None)
        if answer is not None:
            self._judge(answer)
        elif self._ws.handshake_exc is not None:
            self._broken()
        for message in self._messages.take(len(data), events):
            if self._party is not None:
                self._party.learn(self, Told(message))
        if not self._unfinished.weighs(self._messages.unfinished_bytes):
            self._too_much()
        elif self._ws.close_rcvd is not None:
            self._closed(self._ws.close_rcvd.code)
        elif self._ws.parser_exc is not None:
            # The core broke the protocol, or said too much at a time: what it was told, the browser is told.
            self._closed(self._ws.close_sent.code if self._ws.close_sent is not None else FAILED)

    def connection_lost(self, exc: Exception | None) -> None:
        """The core, or its end, is gone."""
        del exc  # why it ended makes no difference
        self._transport = None
        self._unfinished.weighs(0)
        self._unsent.weighs(0)
        party, self._party = self._party, None
        if party is not None:
            party.learn(self, Lost())

    def pause_writing(self) -> None:
        """The core reads slowly: what waits for it counts."""
        waiting = self._transport.get_write_buffer_size() if self._transport is not None else 0
        if not self._unsent.weighs(waiting):
            self._too_much()
        elif self._party is not None:
            self._party.flowing(self, on=False)

    def resume_writing(self) -> None:
        """The core reads again."""
        self._unsent.weighs(0)
        if self._party is not None:
            self._party.flowing(self, on=True)

    # -- what came -------------------------------------------------------------------------------------

    def _judge(self, answer: Response) -> None:
        party = self._party
        if party is None:
            return
        lines = [(n.encode("latin-1"), v.encode("latin-1")) for n, v in answer.headers.raw_items()]
        head = read_answer(answer.status_code, answer.reason_phrase.encode("latin-1"), lines)
        if self._ws.handshake_exc is None:
            party.learn(self, Accepted(head))
        elif answer.status_code == 101:
            self._broken()
        else:
            self._end()
            party.learn(self, Declined(Answer(head, bytes(answer.body))))

    def _broken(self) -> None:
        party = self._party
        self._end()
        if party is not None:
            party.learn(self, Broken())

    def _too_much(self) -> None:
        """There is no room for what this socket keeps."""
        party = self._party
        self.leave(TRY_LATER)
        if party is not None:
            party.learn(self, Closed(TRY_LATER))

    def _closed(self, code: int) -> None:
        party = self._party
        self._end()
        if party is not None:
            party.learn(self, Closed(code))

    def _end(self) -> None:
        self._party = None
        if self._transport is not None:
            self._transport.close()

    def _flush(self) -> None:
        if self._transport is None:
            return
        for data in self._ws.data_to_send():
            if data:
                self._transport.write(data)
            else:
                self._transport.close()
