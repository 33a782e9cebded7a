"""Keeps the investigators' process: started when somebody asks for it or an incident was told, ended with the guard.

It reads what the guard has left in files and never the other way round, so nothing here is waited for by the recovery,
and one that dies is started again only when it is wanted again. It ends by itself when nobody asks it anything. One that
an earlier guard started is gone on with: whether somebody listens is what its socket says, and that there is only one is
seen to by its own lock. Not chosen: to keep it running like a gateway; a page that nobody looks at needs no process.
"""

import asyncio
import shutil
import signal
import socket
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, Final, Protocol

from hardcore.host import lives, logs, processes
from hardcore.host.folders import Folders
from hardcore.host.leftovers import environment_of_investigator
from hardcore.host.processes import Handle

#: From its start to its first answer; on a machine that is busy with a recovery it comes last.
LISTEN_S: Final = 20.0
LOOK_EVERY_S: Final = 0.05
#: Making a process takes milliseconds; a disk that does not give its log for this long may never do so.
MAKING_S: Final = 5.0
#: Asked to end, it finishes what it writes.
LEAVE_S: Final = 3.0
NICE: Final = "10"


class Hands(Protocol):
    """What is needed of the executor around it."""

    async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
        """Run blocking work on a hand's thread."""

    def note(self, kind: str, **particulars: object) -> None:
        """Write a line to the guard's log."""


class Investigators:
    """Owns the investigators' process."""

    def __init__(self, folders: Folders, hands: Hands) -> None:
        self._folders = folders
        self._hands = hands
        self._held: list[Handle] = []
        self._starting = asyncio.Lock()
        self._wanted = True

    def inherit(self, older: Sequence[Handle]) -> None:
        """Go on with those that an earlier guard has started."""
        self._held += older

    async def wake(self) -> None:
        """As `listen`, for somebody who does not wait for it; while they are being started that is enough."""
        if self._starting.locked():
            return
        failed = await self.listen()
        if failed:
            self._hands.note("investigators", failed=failed)

    async def listen(self) -> str:
        """Have them listen; return why they do not, empty once they do."""
        async with self._starting:
            if not self._wanted:
                return "The guard is ending."
            if await self._hands.in_hand(listens, self._folders):
                return ""
            self._bury()
            try:
                handle = await self._hands.in_hand(self._start)
            except OSError as error:
                return f"The investigators could not be started ({error.strerror})."
            self._held.append(handle)
            return await self._answers(handle)

    async def _answers(self, handle: Handle) -> str:
        loop = asyncio.get_running_loop()
        give_up_at = loop.time() + LISTEN_S
        while self._wanted and loop.time() < give_up_at:
            ended = await processes.gone(handle, LOOK_EVERY_S)
            if await self._hands.in_hand(listens, self._folders):
                return ""
            if ended:
                return "The investigators ended at once (logs/postmortem.log says why)."
        return f"The investigators do not answer after {LISTEN_S:g} s."

    def _start(self) -> Handle:
        folders = self._folders
        argv = [sys.executable, "-I", "-m", "postmortem", "serve", "--data", str(folders.data)]
        argv += ["--socket", str(folders.investigator), "--control", str(folders.control)]
        return processes.spawn(
            ["nice", "-n", NICE, *argv] if shutil.which("nice") else argv,
            environment_of_investigator(folders),
            logs.place(folders.logs / "postmortem.log", folders.run),
            folders.data,
        )

    def _bury(self) -> None:
        """Let go of those that have ended."""
        for handle in list(self._held):
            if handle.reap() is not None:
                handle.close()
                self._held.remove(handle)

    async def stop(self) -> None:
        """Have them leave; end those that do not."""
        self._wanted = False
        # Those that are just being started would be left behind by nobody's hand; but their making may hang.
        with suppress(TimeoutError):
            await asyncio.wait_for(self._starting.acquire(), MAKING_S)
            self._starting.release()  # whoever comes to it now finds that none are wanted
        self._bury()
        for handle in self._held:
            handle.signal(signal.SIGTERM)
            handle.signal(signal.SIGCONT)  # a stopped one could not obey
        for handle in self._held:
            if not await processes.gone(handle, LEAVE_S):
                await self._hands.in_hand(handle.kill_tree)
                await processes.gone(handle, lives.KILL_S)
        self._bury()


def listens(folders: Folders) -> bool:
    """Tell whether somebody takes connections where the investigators do."""
    try:
        with socket.socket(socket.AF_UNIX) as connection:
            connection.settimeout(LOOK_EVERY_S)
            connection.connect(str(folders.investigator))
    except OSError:
        return False
    return True
