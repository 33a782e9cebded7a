"""The demo's door: asks the sentinel to break the core, as `hardcore drill` does.

Only a gateway that was started for a demo has one; the sentinel decides, and its policy may still say no. The
question goes over a connection of its own, because the feed's is for facts and is answered by nobody.
"""

import asyncio
from collections.abc import Callable

import msgspec

from hardcore.control.protocol import DRILLS, BadRequest, read_object, write_line
from hardcore.crisis.routing import DRILL_PREFIX

LINE_BYTES_MAX = 64 << 10
#: The sentinel asks the core in turn, for at most 2 s.
ANSWER_S = 5.0

#: Not a poisoned request: whoever asks for that one has to send it too, and only the command line does; it also names
#: the part that is to stand still, and how fast a core is to leak.
_FAULTS = {fault.encode(): fault for fault in DRILLS if fault not in {"poison", "leak", "stall"}}


class Begun(msgspec.Struct, frozen=True):
    """The core is being broken."""

    fault: str


class Declined(msgspec.Struct, frozen=True):
    """The sentinel will not, and the code it gives."""

    code: str


class Unheard(msgspec.Struct, frozen=True):
    """No sentinel answered."""


Said = Begun | Declined | Unheard


def fault_of(path: bytes) -> str | None:
    """The fault that a path under DRILL_PREFIX names; None if there is no such drill."""
    return _FAULTS.get(path.removeprefix(DRILL_PREFIX))


class DrillDoor:
    """Asks one sentinel; each question is a task of its own that ends by itself."""

    def __init__(self, loop: asyncio.AbstractEventLoop, control: str) -> None:
        self._loop = loop
        self._control = control
        self._asking: set[asyncio.Task[None]] = set()

    def ask(self, fault: str, then: Callable[[Said], None]) -> None:
        """Have the core broken with `fault`; `then` is told what the sentinel said."""
        task = self._loop.create_task(self._ask(fault, then))
        self._asking.add(task)
        task.add_done_callback(self._asking.discard)

    async def _ask(self, fault: str, then: Callable[[Said], None]) -> None:
        try:
            line = await asyncio.wait_for(_question(self._control, fault), ANSWER_S)
        except (OSError, TimeoutError, ValueError):  # ValueError: a line without an end
            then(Unheard())
            return
        then(_heard(line, fault))


async def _question(control: str, fault: str) -> bytes:
    reader, writer = await asyncio.open_unix_connection(control, limit=LINE_BYTES_MAX)
    try:
        # Whoever presses the button is one of the open connections that the sentinel would ask about.
        writer.write(write_line({"verb": "drill", "fault": fault, "yes": True}))
        await writer.drain()
        return await reader.readline()
    finally:
        writer.close()


def _heard(line: bytes, fault: str) -> Said:
    answer = read_object(line)
    if isinstance(answer, BadRequest):
        return Unheard()
    return Begun(fault) if answer.get("ok") is True else Declined(str(answer.get("code", ""))[:40])
