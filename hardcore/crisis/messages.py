"""WebSocket messages: put together from frames, and made into the bytes of one frame.

Messages are passed on whole or not at all: a core that dies in the middle of one leaves nothing half said, and
a word of the gateway's own never falls between two halves. Passing frames on one by one was not chosen for that.
"""

import logging
from collections.abc import Sequence

import msgspec
from websockets.frames import Frame, Opcode
from websockets.protocol import Event

#: What the library would log of a connection (addresses, payloads) is nobody's business.
SILENT = logging.getLogger("hardcore.crisis.websockets")
SILENT.setLevel(logging.CRITICAL + 1)

PING = Frame(Opcode.PING, b"").serialize(mask=False)


class Message(msgspec.Struct, frozen=True):
    """A whole message. `text` or bytes."""

    text: bool
    data: bytes


class Messages(msgspec.Struct):
    """Puts frames together. How long a message may grow is judged by the protocol beneath.

    What has come of one is kept as bytes, not as its frames: a frame may be empty, and a million of them would
    grow past every bound that counts bytes.
    """

    _text: bool = True
    _begun: bytearray = msgspec.field(default_factory=bytearray)
    _frame_bytes: int = 0  # read since a frame was whole

    @property
    def unfinished_bytes(self) -> int:
        """How much is kept of what is not whole."""
        return len(self._begun) + self._frame_bytes

    def take(self, read_bytes: int, events: Sequence[Event]) -> list[Message]:
        """The messages that are whole now that so much was read and led to `events`."""
        self._frame_bytes = 0 if events else self._frame_bytes + read_bytes
        whole: list[Message] = []
        for event in events:
            if not isinstance(event, Frame):
                continue
            if event.opcode in {Opcode.TEXT, Opcode.BINARY}:
                self._text = event.opcode is Opcode.TEXT
            elif event.opcode is not Opcode.CONT:
                continue
            self._begun += event.data
            if event.fin:
                whole.append(Message(self._text, bytes(self._begun)))
                self._begun = bytearray()
        return whole


def frame_of(message: Message) -> bytes:
    """The bytes that say `message` to a browser: the same for everybody, so made once."""
    opcode = Opcode.TEXT if message.text else Opcode.BINARY
    return Frame(opcode, message.data).serialize(mask=False)
