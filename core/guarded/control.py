"""The core's own control socket: a door for its guard, one JSON line in, one JSON line out.

The socket belongs to one life and has mode 0600 from its first moment. Orders carry the generation of the
sentinel that gives them, and one that is older than another already seen is refused: a sentinel that woke
up late must not break a core that a newer one looks after. Lines, connections and silence are bounded, so
the door can't be used to hurt the core. Not chosen: HTTP beside the ledger's routes; then an order would
queue behind the load that it is about.
"""

import asyncio
import contextlib
import json
import os
import socket
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from core.guarded.drills import Drill, carry_out

LINE_BYTES_MAX = 4096
CONNECTIONS_MAX = 8
SILENCE_S_MAX = 10.0


class ControlUnboundError(OSError):
    """The control socket can't be bound; `strerror` says why. The guard has to name another path."""


@dataclass(frozen=True, slots=True)
class Standing:
    """Where the core stands: its epoch (0: none raised yet) and the last committed sequence."""

    epoch: int
    seq: int


@dataclass(frozen=True, slots=True)
class StatusOrder:
    """Asks where the core stands."""


@dataclass(frozen=True, slots=True)
class DrillOrder:
    """Asks the core to break itself."""

    drill: Drill
    generation: int


@dataclass(frozen=True, slots=True)
class Refused:
    """An order that is not carried out, and why."""

    error: str


def read_order(line: bytes, lowest_generation: int) -> StatusOrder | DrillOrder | Refused:
    """Return the order on one line; never raises. Orders below `lowest_generation` are refused."""
    try:
        said = json.loads(line)
    except (ValueError, RecursionError):
        return Refused("The line is not JSON.")
    if not isinstance(said, dict):
        return Refused("The line is not a JSON object.")
    match said.get("verb"):
        case "status":
            return StatusOrder()
        case "drill":
            return _read_drill(said.get("fault"), said.get("generation"), lowest_generation)
        case _:
            return Refused("The verb must be status or drill.")


def _read_drill(fault: object, generation: object, lowest: int) -> DrillOrder | Refused:
    if not isinstance(fault, str) or fault not in set(Drill):
        return Refused(f"The fault must be one of {', '.join(Drill)}.")
    if not isinstance(generation, int) or isinstance(generation, bool) or generation < 0:
        return Refused("The generation must be a whole number.")
    if generation < lowest:
        return Refused(f"Generation {generation} is over: {lowest} gives the orders.")
    return DrillOrder(Drill(fault), generation)


def bind_private(path: Path) -> socket.socket:
    """Return a Unix socket bound to `path` that nobody but its owner can ever have opened.

    Raises OSError when there is something at `path` already or it can't be made.
    """
    door = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
    try:
        # Before bind: the file is made with this mode. A chmod after it would leave a moment between.
        os.fchmod(door.fileno(), 0o600)
        door.bind(bytes(path))
    except BaseException:
        door.close()
        raise
    return door


class ControlServer:
    """Answers orders until it is closed."""

    def __init__(
        self,
        path: Path,
        standing: Callable[[], Standing],
        note: Callable[[str, str], None],
        silence_s: float = SILENCE_S_MAX,
    ) -> None:
        """Serve on `path`. `standing` is asked for each status; `note` is told code and text of a drill.

        Who says nothing for `silence_s` is hung up on.
        """
        self._path = path
        self._silence_s = silence_s
        self._standing = standing
        self._note = note
        self._generation = 0
        self._server: asyncio.Server | None = None
        self._talks: set[asyncio.Task[None]] = set()

    async def open(self) -> None:
        """Begin to answer. Raises ControlUnboundError when there is no socket to be had at the path."""
        try:
            door = bind_private(self._path)
        except OSError as error:
            raise ControlUnboundError(error.errno, error.strerror) from error
        self._server = await asyncio.start_unix_server(self._accept, sock=door, limit=LINE_BYTES_MAX)

    async def close(self) -> None:
        """Answer no more; open connections are closed."""
        if self._server is not None:
            self._server.close()
            self._server = None
            self._path.unlink(missing_ok=True)
        for talk in self._talks:
            talk.cancel()
        await asyncio.gather(*self._talks, return_exceptions=True)

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if len(self._talks) >= CONNECTIONS_MAX:
            writer.close()
            return
        talk = asyncio.get_running_loop().create_task(self._talk(reader, writer), name="control")
        self._talks.add(talk)
        talk.add_done_callback(self._talks.discard)

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while line := await asyncio.wait_for(self._line(reader), self._silence_s):
                await self._answer(line, writer)
        except (TimeoutError, ConnectionError):
            pass  # Somebody who is silent or gone needs no answer.
        finally:
            writer.close()

    async def _line(self, reader: asyncio.StreamReader) -> bytes:
        """Return the next line; nothing at the end, or when it is too long to be one of ours."""
        try:
            return await reader.readline()
        except ValueError:
            return b""

    async def _answer(self, line: bytes, writer: asyncio.StreamWriter) -> None:
        match read_order(line, self._generation):
            case StatusOrder():
                now = self._standing()
                await _say(writer, {"ok": True, "pid": os.getpid(), "epoch": now.epoch, "seq": now.seq})
            case DrillOrder(drill, generation):
                self._generation = generation
                self._note("DRILL", drill.value)
                with contextlib.suppress(ConnectionError):
                    await _say(writer, {"ok": True})
                    # Closed first: the answer has then left this process, whatever the drill does to it.
                    writer.close()
                    await writer.wait_closed()
                carry_out(drill)
            case Refused(error):
                await _say(writer, {"ok": False, "error": error})


async def _say(writer: asyncio.StreamWriter, answer: dict[str, object]) -> None:
    writer.write(json.dumps(answer).encode() + b"\n")
    await writer.drain()
