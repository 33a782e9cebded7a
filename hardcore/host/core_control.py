"""Gives an order to a core over its own control socket, and waits a bounded time for its answer.

The order itself is on its way before anything is waited for: a Unix socket takes a connection and a small packet at
once or not at all. That spares the path of a switch some turns of the loop, and a connection that would have to be
kept open for that.
"""

import asyncio
import json
import socket
from collections.abc import Mapping
from pathlib import Path

import msgspec

ANSWER_BYTES_MAX = 4096
WORDS_MAX = 200


class Answer(msgspec.Struct, frozen=True):
    """What came of an order: empty `refused` if the core says that it did it, else why it did not or may not have.

    `heard`: it answered at all. `said`: its whole answer.
    """

    refused: str
    heard: bool = False
    said: Mapping[str, object] = msgspec.field(default_factory=dict)


class Told:
    """An order that was sent, or could not be. `answer` is waited for once."""

    def __init__(self, control: Path, order: Mapping[str, object]) -> None:
        self._socket = socket.socket(
            socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC
        )
        self._fault: OSError | None = None
        try:
            self._socket.connect(str(control))
            self._socket.sendall(json.dumps(order).encode() + b"\n")
        except OSError as error:
            self._fault = error

    async def answer(self, within_s: float) -> Answer:
        """Wait for the core's answer."""
        with self._socket:
            try:
                if self._fault is not None:
                    raise self._fault
                line = await asyncio.wait_for(self._line(), within_s)
                said = json.loads(line) if line else None
            except TimeoutError:
                return Answer(f"the core did not answer within {within_s:g} s")
            except (OSError, ValueError, RecursionError) as error:
                return Answer(f"the core's control socket does not answer ({type(error).__name__})")
        if not isinstance(said, dict):
            return Answer("the core hung up")
        if said.get("ok") is True:
            return Answer("", heard=True, said=said)
        return Answer(str(said.get("error", "it gave no reason"))[:WORDS_MAX], heard=True, said=said)

    async def _line(self) -> bytes:
        loop = asyncio.get_running_loop()
        line = b""
        while not line.endswith(b"\n"):
            part = await loop.sock_recv(self._socket, ANSWER_BYTES_MAX)
            line += part
            if not part:
                return b""
            if len(line) > ANSWER_BYTES_MAX:
                raise ValueError("an answer of a core is one short line")
        return line


async def give(control: Path, order: Mapping[str, object], within_s: float) -> str:
    """Have a core do something; return why it did not or may not have, empty when it says that it did."""
    return (await Told(control, order).answer(within_s)).refused
