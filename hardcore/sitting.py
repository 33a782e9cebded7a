"""One sitting of the court: a throw-away core's process, started for a docket, heard line by line, ended in any case.

It runs beside the core that serves and behind it: at low priority, in a session of its own, and it says what it found on
a pipe, so that it can't outlive by much a guard that nobody hears any more. Whatever it is silent about for too long
counts as its own fault, never as a suspect's. A successor finds it by its environment and ends it. Not chosen: to reap
it by its exit code alone; what it had said until it was killed is still true.
"""

import asyncio
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Final, Protocol

import msgspec

from hardcore.host import clock, docket, files, lives, logs, processes
from hardcore.host.docket import Heard, Said
from hardcore.host.folders import Folders
from hardcore.host.leftovers import environment_of_court
from hardcore.host.processes import Handle
from hardcore.model.observations import Exit

#: The copy of a large ledger, on a slow disk.
COPY_S: Final = 180.0
#: A throw-away core starts anew after each case that ends one; its start is not the case's time.
START_S: Final = 30.0
#: The search in a log starts a core for each half of it.
STARTS_OF_A_SEARCH: Final = 24
#: Asked to end, it removes its copy and goes.
LEAVE_S: Final = 3.0
NICE: Final = "10"
#: A court that says nothing of use any more is ended; each case has a few lines.
LINES_MAX: Final = 4 * docket.CASES_MAX
_FAULTS: Final[Mapping[int, str]] = {
    73: "there is no room for a copy of the ledger",
    78: "the docket can't be used",
}
#: The exit code of a court that would not take its docket.
UNUSABLE: Final = 78


class Hands(Protocol):
    """What a sitting needs of the executor around it."""

    async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
        """Run blocking work on a hand's thread."""

    def note(self, kind: str, **particulars: object) -> None:
        """Write a line to the guard's log."""


class Terms(msgspec.Struct, frozen=True):
    """What the cases of a docket may cost. `memory_bytes` 0: without a bound."""

    limit_ms: int
    memory_bytes: int
    search: bool = False  # the log itself is on trial

    @property
    def silent_s(self) -> float:
        """How long it may say nothing once it has its copy."""
        each_s = self.limit_ms / 1000 + START_S
        return each_s * STARTS_OF_A_SEARCH if self.search else each_s


class Over(msgspec.Struct, frozen=True):
    """How a sitting ended. Empty `fault`: it did its work. `unusable`: it would not take its docket."""

    fault: str
    unusable: bool = False


async def sit(
    hands: Hands,
    folders: Folders,
    cases: Iterable[Mapping[str, Any]],
    terms: Terms,
    tell: Callable[[Heard | Said], None],
) -> Over:
    """Have these cases tried, and tell each verdict as it comes, and how far it is. Ends the court when it is cancelled."""
    told = list(cases)
    paper = docket.docket(told, terms.limit_ms, terms.memory_bytes)
    try:
        handle, pipe = await hands.in_hand(_start, folders, paper)
    except OSError as error:
        return Over(f"no court could be made: {error.strerror}")
    said_over = False
    try:
        names = frozenset(str(case["name"]) for case in told)
        said_over = await _listen(pipe, names, terms, tell)
        await processes.gone(handle, LEAVE_S)
    finally:
        how = await _see_off(hands, handle)
    if said_over:
        return Over("")
    fault = _FAULTS.get(how.code or 0, "")
    ended = f"signal {how.signal}" if how.signal is not None else f"code {how.code}"
    return Over(fault or f"the court ended before its work was done ({ended})", how.code == UNUSABLE)


def _start(folders: Folders, paper: bytes) -> tuple[Handle, int]:
    """Return the court's process and the end of its pipe. Blocks; raises OSError."""
    path = _docket_of(folders)
    files.write_whole(path, paper, durable=False)
    argv = [sys.executable, "-I", "-m", "core", "try", "--data", str(folders.data), "--docket", str(path)]
    log = logs.place(folders.logs / "court.log", folders.run)
    ours, theirs = os.pipe2(os.O_CLOEXEC)
    try:
        handle = processes.spawn(
            ["nice", "-n", NICE, *argv] if shutil.which("nice") else argv,
            environment_of_court(folders),
            log,
            folders.data,
            stdout=theirs,
        )
    except BaseException:
        os.close(ours)
        raise
    finally:
        os.close(theirs)
    return handle, ours


def _docket_of(folders: Folders) -> Path:
    return folders.run / "docket.json"


async def _listen(
    pipe: int, names: frozenset[str], terms: Terms, tell: Callable[[Heard | Said], None]
) -> bool:
    """Hear what it says until it says that it is over, hangs up, or is silent for too long; return whether it is over."""
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader(limit=docket.LINE_BYTES_MAX)
    transport, _ = await loop.connect_read_pipe(
        lambda: asyncio.StreamReaderProtocol(reader), os.fdopen(pipe, "rb", buffering=0)
    )
    patience_s = COPY_S
    try:
        for _ in range(LINES_MAX):
            line = await asyncio.wait_for(reader.readline(), patience_s)
            if not line:
                return False
            heard = docket.read_line(line, names, clock.now_ns())
            match heard:
                case Said(over=True):
                    return True
                case Heard() | Said():
                    tell(heard)
                case _:
                    pass  # nothing that we understand
            patience_s = max(terms.silent_s, START_S)
    except (TimeoutError, ValueError):  # silent for too long, or a line without an end
        return False
    finally:
        transport.close()
    return False


async def _see_off(hands: Hands, handle: Handle) -> Exit:
    """Wait for its end, asking for it where it does not come by itself; nothing that it started stays."""
    try:
        if not await processes.gone(handle, 0.0):
            handle.signal(signal.SIGTERM)
            await processes.gone(handle, LEAVE_S)
        await hands.in_hand(handle.kill_tree)  # what it started is in its session
        await processes.gone(handle, lives.KILL_S)
    finally:
        how = handle.reap()
        handle.close()
    return how or Exit()
