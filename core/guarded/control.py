"""The core's own control socket: a door for its guard, one JSON line in, one JSON line out.

The socket belongs to one life and has mode 0600 from its first moment. What an order says is read by `orders`,
what it does is the business of whoever is `Guarded`: here are only the door and its bounds. Lines, connections
and silence are bounded, so the door can't be used to hurt the core. Not chosen: HTTP beside the ledger's
routes; then an order would queue behind the load that it is about.
"""

import asyncio
import contextlib
import json
import os
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, assert_never

import msgspec

from core.guarded.orders import (
    CheckpointOrder,
    ComponentOrder,
    DrainOrder,
    DrillOrder,
    Order,
    PromoteOrder,
    QuarantineOrder,
    Refused,
    SafeOrder,
    StatusOrder,
    TasksOrder,
    generation_of,
    read_order,
)
from core.guarded.tasks import suspended_tasks

VERSION = 2  # of what can be said through this door (`docs/wires.md` section 4)
LINE_BYTES_MAX = 4096
CONNECTIONS_MAX = 8
SILENCE_S_MAX = 10.0


class ControlUnboundError(OSError):
    """The control socket can't be bound; `strerror` says why. The guard has to name another path."""


class Standing(msgspec.Struct, frozen=True):
    """Where the core stands: its epoch (0: none raised yet), the last committed sequence, why it only reads.

    `spare`: it waits to be promoted. `build`: the name of its code, empty while it is not known. `drained`: it has
    let go of its store and only waits for TERM. `checkpoint`: by which one its start went, empty: by none.
    """

    epoch: int
    seq: int
    safe: str | None = None
    spare: bool = False
    build: str = ""
    drained: bool = False
    checkpoint: str = ""


class RulesRead(msgspec.Struct, frozen=True):
    """The rules in force: the number of their file, and how many they are."""

    serial: int
    rules: int


class CheckpointMade(msgspec.Struct, frozen=True):
    """The checkpoint that stands for the ledger as it is now: its name, and the last event in it."""

    name: str
    seq: int


class Guarded(Protocol):
    """What takes the orders. All on the loop's thread."""

    def standing(self) -> Standing:
        """Return where the core stands."""
        ...

    async def switch_safe(self, order: SafeOrder) -> str | None:
        """Serve reads only, or everything again; return why that could not be done, None if it is done."""
        ...

    def drill(self, order: DrillOrder) -> Callable[[], object] | str:
        """Return what breaks the core once it is called, or why it can't be broken in this way now."""
        ...

    def promote(self, order: PromoteOrder) -> Callable[[], object] | str:
        """Return what has this spare take over once it is called, or why it can't."""
        ...

    async def drain(self, order: DrainOrder) -> int | str:
        """Finish everything and let go of the store; return the last sequence, or why that could not be done."""
        ...

    async def read_rules(self) -> RulesRead | str:
        """Read the rules anew; return what is in force now, or why those before them stay in force."""
        ...

    async def restart_component(self, order: ComponentOrder) -> str | None:
        """End one component and begin it anew; return why that could not be done, None if it is done."""
        ...

    async def checkpoint(self) -> CheckpointMade | str:
        """Make a checkpoint; return the one that stands for the ledger now, or why there is none."""
        ...


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
        guarded: Guarded,
        note: Callable[[str, str], None],
        silence_s: float = SILENCE_S_MAX,
    ) -> None:
        """Serve on `path`. `guarded` takes the orders; `note` is told code and text of each that changes something.

        Who says nothing for `silence_s` is hung up on.
        """
        self._path = path
        self._silence_s = silence_s
        self._guarded = guarded
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
                order = read_order(line, self._generation)
                self._generation = max(self._generation, generation_of(order))
                await self._answer(order, writer)
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

    async def _answer(self, order: Order, writer: asyncio.StreamWriter) -> None:
        match order:
            case StatusOrder():
                now = self._guarded.standing()
                await _say(writer, {"ok": True, "pid": os.getpid(), **msgspec.structs.asdict(now)})
            case TasksOrder():
                tasks, count = suspended_tasks()
                await _say(writer, {"ok": True, "tasks": tasks, "count": count})
            case SafeOrder(on, reason):
                self._note("SAFE", reason if on else f"no longer {reason}")
                await _say(writer, _outcome(await self._guarded.switch_safe(order)))
            case DrillOrder():
                await self._drill(order, writer)
            case PromoteOrder():
                await self._promote(order, writer)
            case DrainOrder(within_ms):
                self._note("DRAIN", f"within {within_ms} ms")
                outcome = await self._guarded.drain(order)
                await _say(
                    writer, {"ok": True, "seq": outcome} if isinstance(outcome, int) else _outcome(outcome)
                )
            case QuarantineOrder():
                await self._read_rules(writer)
            case ComponentOrder(name):
                self._note("COMPONENT", name)
                await _say(writer, _outcome(await self._guarded.restart_component(order)))
            case CheckpointOrder():
                made = await self._guarded.checkpoint()
                await _say(
                    writer,
                    _outcome(made) if isinstance(made, str) else {"ok": True, **msgspec.structs.asdict(made)},
                )
            case Refused(error):
                await _say(writer, _outcome(error))
            case _:
                assert_never(order)

    async def _drill(self, order: DrillOrder, writer: asyncio.StreamWriter) -> None:
        begin = self._guarded.drill(order)
        if isinstance(begin, str):
            await _say(writer, _outcome(begin))
            return
        self._note("DRILL", order.drill.value)
        with contextlib.suppress(ConnectionError):
            await _say(writer, {"ok": True})
            # Closed first: the answer has then left this process, whatever the drill does to it.
            writer.close()
            await writer.wait_closed()
        begin()

    async def _read_rules(self, writer: asyncio.StreamWriter) -> None:
        found = await self._guarded.read_rules()
        if isinstance(found, str):
            self._note("RULES_UNREAD", found)
            await _say(writer, _outcome(found))
            return
        self._note("RULES", f"{found.rules} of serial {found.serial}")
        await _say(writer, {"ok": True, **msgspec.structs.asdict(found)})

    async def _promote(self, order: PromoteOrder, writer: asyncio.StreamWriter) -> None:
        begin = self._guarded.promote(order)
        if isinstance(begin, str):
            await _say(writer, _outcome(begin))
            return
        self._note("PROMOTE", f"from epoch {order.expected_epoch}")
        try:
            await _say(writer, {"ok": True})
        finally:
            begin()  # also where nobody waits for the answer any more: the order was given


def _outcome(error: str | None) -> dict[str, object]:
    return {"ok": True} if error is None else {"ok": False, "error": error}


async def _say(writer: asyncio.StreamWriter, answer: dict[str, object]) -> None:
    writer.write(json.dumps(answer).encode() + b"\n")
    await writer.drain()
