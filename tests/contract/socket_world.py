"""The two far ends of a WebSocket through the gateway: a page, and a core that speaks the protocol by hand.

The page is a real client over a real socket; the core's end is the library's protocol without its input and
output, so that a test decides each word, each close and each silence.
"""

import contextlib
import json
import threading
from collections.abc import Callable, Iterator
from typing import Any, Self

from websockets.exceptions import ConnectionClosed
from websockets.frames import Frame, Opcode
from websockets.protocol import CLOSED, SERVER, State
from websockets.protocol import Protocol as Talk
from websockets.sync.client import ClientConnection, connect
from websockets.utils import accept_key

from tests.contract.gateway_world import DEADLINE_S, Call, Feed, Watched, World

RESUMABLE = "hardcore.v1"


class CoreEnd:
    """The core's end of one socket, open."""

    def __init__(self, call: Call, subprotocol: str | None, *, epoch: int | None) -> None:
        self.target = call.request.target
        self.request = call.request
        self.heard = Watched()
        self.closed_with = Watched()
        self._call = call
        self._talk = Talk(SERVER, state=State.OPEN)
        self._lock = threading.Lock()
        key = call.request.header("Sec-WebSocket-Key")
        assert key is not None
        lines = ["HTTP/1.1 101 Switching Protocols", "Upgrade: websocket", "Connection: Upgrade"]
        lines.append(f"Sec-WebSocket-Accept: {accept_key(key)}")
        if subprotocol is not None:
            lines.append(f"Sec-WebSocket-Protocol: {subprotocol}")
        if epoch is not None:
            lines.append(f"X-Core-Epoch: {epoch}")
        call.raw("\r\n".join([*lines, "", ""]).encode())

    def run(self, hears: threading.Event | None = None) -> None:
        """Take in what comes until the end; nothing before `hears`."""
        if hears is not None:
            hears.wait(DEADLINE_S)
        while self._talk.state is not CLOSED:
            data = self._call.connection.recv(65536)
            with self._lock:
                if not data:
                    return
                self._talk.receive_data(data)
                for event in self._talk.events_received():
                    if isinstance(event, Frame) and event.opcode in {Opcode.TEXT, Opcode.BINARY}:
                        self.heard.append(bytes(event.data))
                    elif isinstance(event, Frame) and event.opcode is Opcode.CLOSE:
                        assert self._talk.close_rcvd is not None
                        self.closed_with.append(self._talk.close_rcvd.code)
                self._flush()

    def say(self, said: object) -> None:
        self._write(Opcode.TEXT, json.dumps(said).encode())

    def say_bytes(self, data: bytes) -> None:
        self._write(Opcode.BINARY, data)

    def say_half(self, text: bytes) -> None:
        self._write(Opcode.TEXT, text, fin=False)

    def _write(self, opcode: Opcode, data: bytes, *, fin: bool = True) -> None:
        """Say it whatever was said before, as a core may that does not know that it was left."""
        with self._lock:
            self._call.raw(Frame(opcode, data, fin).serialize(mask=False))

    def close(self, code: int) -> None:
        with self._lock:
            self._talk.send_close(code)
            self._flush()

    def _flush(self) -> None:
        for data in self._talk.data_to_send():
            if data:
                self._call.raw(data)


class Ends:
    """A core's script that accepts every socket and keeps its ends."""

    def __init__(
        self,
        subprotocol: str | None = RESUMABLE,
        *,
        epoch: int | None = -1,
        hears: threading.Event | None = None,
    ) -> None:
        self._subprotocol = subprotocol
        self._epoch = epoch
        self._hears = hears
        self.ends = Watched()

    def __call__(self, call: Call) -> None:
        end = CoreEnd(call, self._subprotocol, epoch=call.epoch if self._epoch == -1 else self._epoch)
        self.ends.append(end)
        end.run(self._hears)

    def wait(self, count: int = 1) -> CoreEnd:
        found = self.ends.wait(lambda _: True, count)[count - 1]
        assert isinstance(found, CoreEnd)
        return found


class Page:
    """A page's socket."""

    def __init__(self, connection: ClientConnection) -> None:
        self._connection = connection

    @property
    def subprotocol(self) -> str | None:
        return self._connection.subprotocol

    def read(self) -> Any:
        """The next frame as JSON, in time."""
        return json.loads(self._connection.recv(DEADLINE_S))

    def read_raw(self) -> str | bytes:
        return self._connection.recv(DEADLINE_S)

    def read_until(self, wanted: Callable[[Any], bool]) -> Any:
        """Read on to the first frame that is wanted."""
        while not wanted(frame := self.read()):
            pass
        return frame

    def read_type(self, kind: str) -> Any:
        return self.read_until(lambda frame: frame["type"] == kind)

    def read_text(self, text: str | None) -> Any:
        return self.read_until(lambda frame: frame["type"] == "state" and frame["text"] == text)

    def say(self, text: str | bytes) -> Self:
        self._connection.send(text)
        return self

    def say_half(self, data: bytes) -> Self:
        """Begin a message."""
        self._connection.socket.sendall(Frame(Opcode.TEXT, data, fin=False).serialize(mask=True))
        return self

    def heard(self) -> None:
        """Wait until the gateway has heard all that was said."""
        assert self._connection.ping().wait(DEADLINE_S)

    def say_other_half(self, data: bytes) -> None:
        """End the message that was begun."""
        self._connection.socket.sendall(Frame(Opcode.CONT, data).serialize(mask=True))

    def closed(self) -> int | None:
        """The code with which the gateway closes; what it says before is passed over."""
        try:
            while True:
                self._connection.recv(DEADLINE_S)
        except ConnectionClosed as end:
            return end.rcvd.code if end.rcvd is not None else None

    def close(self, code: int = 1000) -> None:
        self._connection.close(code)

    def vanish(self) -> None:
        """As a page whose machine was switched off."""
        self._connection.socket.close()


@contextlib.contextmanager
def page(
    world: World, target: str = "/ws", subprotocol: str | None = RESUMABLE, **more: Any
) -> Iterator[Page]:
    """A page's socket, open; it is gone afterwards."""
    with connect(
        f"ws://127.0.0.1:{world.port}{target}",
        subprotocols=[subprotocol] if subprotocol is not None else None,  # type: ignore[list-item]
        compression=None,
        open_timeout=DEADLINE_S,
        ping_interval=None,
        close_timeout=DEADLINE_S,
        max_size=None,
        proxy=None,
        **more,
    ) as connection:
        yield Page(connection)


@contextlib.contextmanager
def live(world: World, *headers: tuple[str, str]) -> Iterator[Page]:
    """A page's own socket to the gateway; its first two frames are read."""
    with page(world, "/__hc/live", None, additional_headers=list(headers)) as own:
        assert own.read()["type"] == "hello"
        yield own


#: The headers that ask for a socket.
HANDSHAKE = (
    "Connection: Upgrade",
    "Upgrade: websocket",
    "Sec-WebSocket-Version: 13",
    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
    f"Sec-WebSocket-Protocol: {RESUMABLE}",
)


def down(feed: Feed, since_ns: int, *, stage: int = 2, planned: bool = False, phase: str = "KILLING") -> None:
    """The guard says that the core is down."""
    feed.phase(
        "HOLD", phase=phase, state="RECOVERY", incident="i1", stage=stage, since_ns=since_ns, planned=planned
    )
