"""The line to the guard: one question over its control socket, one answer.

The wire is `docs/wires.md` sections 7 and 16. A guard that is not there is `None`, never an error: everything here has to
work with the ledger and its guard stopped, and says so where it can't. The guard's own client was not imported: the islands
share a wire, not code.
"""

import asyncio
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

ANSWER_BYTES_MAX: Final = 8 << 20
ASK_S: Final = 5.0
#: Where the gateway listens for the owner's own programs, beside the guard's socket.
_OWN_DOOR: Final = "gateway.sock"


class Service(msgspec.Struct, frozen=True):
    """The guarded service as the guard sees it: where it is asked, who serves, and whether it does. `door`: the socket on
    which no password is asked for; empty if there is none.
    """

    url: str
    epoch: int | None
    pid: int | None
    serving: bool
    door: str = ""


class GuardLine(msgspec.Struct, frozen=True):
    """The guard at one control socket."""

    control: Path
    ask_s: float = ASK_S

    async def ask(self, request: Mapping[str, Any]) -> Mapping[str, Any] | None:
        """Ask the guard; None: it is not there, or says nothing in time.

        What is asked here has its line in our own log, in the name of whoever asked, so the guard writes none.
        """
        asked = {**request, "audited": True}
        try:
            async with asyncio.timeout(self.ask_s):
                line = await self._exchange(json.dumps(asked).encode() + b"\n")
            told = json.loads(line)
        except (OSError, ValueError, TimeoutError, RecursionError):
            return None
        return told if isinstance(told, dict) else None

    async def _exchange(self, line: bytes) -> bytes:
        reader, writer = await asyncio.open_unix_connection(self.control, limit=ANSWER_BYTES_MAX)
        try:
            writer.write(line)
            await writer.drain()
            return await reader.readline()
        finally:
            writer.close()

    async def service(self) -> Service | None:
        """How the service is; None: nobody is there to say it."""
        told = await self.ask({"verb": "status"})
        if told is None:
            return None
        core = told.get("core")
        core = core if isinstance(core, dict) else {}
        url = told.get("url")
        serving = core.get("ready") is True and isinstance(url, str) and told.get("phase") in _SERVING
        door = self.control.with_name(_OWN_DOOR)
        return Service(
            url if isinstance(url, str) else "",
            core.get("epoch"),
            core.get("pid"),
            serving,
            str(door) if door.exists() else "",
        )


#: Phases in which a core serves writes or will within moments; a request that is sent in others only waits.
_SERVING: Final = frozenset({"PROBATION", "RUNNING", "SUSPECT", "SNAPSHOT_LIVE"})
