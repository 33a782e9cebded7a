"""WebSocket messages: put together from frames, and made into the bytes of one frame.

Messages are passed on whole or not at all: a core that dies in the middle of one leaves nothing half said, and
a word of the gateway's own never falls between two halves. Passing frames on one by one was not chosen for that.
"""

import logging
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from websockets.frames import Frame, Opcode
from websockets.protocol import Event

#: What the library would log of a connection (addresses, payloads) is nobody's business.
SILENT = logging.getLogger("hardcore.crisis.websockets")
SILENT.setLevel(logging.CRITICAL + 1)

PING = Frame(Opcode.PING, b"").serialize(mask=False)


@dataclass(frozen=True, slots=True)
class Message:
    """A whole message. `text` or bytes."""

    text: bool
    data: bytes


@dataclass(slots=True)
class Messages:
    """Puts frames together. How long a message may grow is judged by the protocol beneath."""

    _text: bool = True
    _parts: list[bytes] = field(default_factory=list)

    def take(self, events: Iterable[Event]) -> Iterator[Message]:
        """The messages that are whole now; other frames are passed over."""
        for event in events:
            if not isinstance(event, Frame):
                continue
            if event.opcode in {Opcode.TEXT, Opcode.BINARY}:
                self._text = event.opcode is Opcode.TEXT
            elif event.opcode is not Opcode.CONT:
                continue
            self._parts.append(bytes(event.data))
            if event.fin:
                parts, self._parts = self._parts, []
                yield Message(self._text, b"".join(parts))


def frame_of(message: Message) -> bytes:
    """The bytes that say `message` to a browser: the same for everybody, so made once."""
    opcode = Opcode.TEXT if message.text else Opcode.BINARY
    return Frame(opcode, message.data).serialize(mask=False)
