"""Drills on a schedule: which is due, whether this is a moment for it, and a child of the guard's own that runs it.

The child is the same command that a person would type, so a drill at four in the morning is held against the same
promises, and its result goes the same way. What was begun is written down first: a guard that dies of a drill does not
begin with it again. A moment that does not come (somebody is connected, an incident is open) lets the day's drill be
left out; nobody is woken for one. Not chosen: a timer of the machine, which knows nothing of who is connected.
"""

import asyncio
import datetime as dt
import shutil
import sys
from collections.abc import Callable, Coroutine
from typing import Any, Final, Protocol

from hardcore.host import files, lives, logs, processes
from hardcore.host.folders import Folders
from hardcore.model.phases import HAState
from hardcore.recovery.policy import Policy
from hardcore.recovery.reading import Reading

#: Whether one is due is looked at this often.
LOOK_EVERY_S: Final = 30.0
#: The longest drill, with its way back and its trial.
DRILL_S: Final = 600.0
#: A schedule of so many hours or more keeps to its hour of the day.
A_DAY_H: Final = 24
#: The same hour of the next day may come a little early.
SLACK: Final = dt.timedelta(hours=1)
NICE: Final = "10"


class Hands(Protocol):
    """What is needed of the executor around it."""

    def begin(self, work: Coroutine[Any, Any, object]) -> None:
        """Start a piece of work that nobody waits for."""

    async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
        """Run blocking work on a hand's thread."""

    def note(self, kind: str, **particulars: object) -> None:
        """Write a line to the guard's log."""


def is_due(now: dt.datetime, last: dt.datetime | None, every_h: int, hour: int) -> bool:
    """Tell whether a drill is due. `now` and `last` are local times with their zone; `every_h` 0: none is, ever.

    The first one waits for its hour. A clock that was set back makes one due again only when it has caught up.
    """
    if not every_h:
        return False
    if last is None:
        return now.hour == hour
    passed = now - last
    if every_h >= A_DAY_H:
        return passed >= dt.timedelta(hours=every_h) - SLACK and now.hour == hour
    return passed >= dt.timedelta(hours=every_h)


def is_moment(reading: Reading, *, quiet: bool) -> bool:
    """Tell whether the ledger may be broken now: it is well, nothing is on its budget, and nobody would notice."""
    well = reading.state is HAState.OPERATIONAL and reading.incident is None and reading.safe is None
    return well and reading.deaths == 0 and not reading.switch_waits and quiet


class Calendar:
    """Has the drills of a policy run."""

    def __init__(self, folders: Folders, policy: Policy, hands: Hands) -> None:
        self._folders = folders
        self.policy = policy
        self._hands = hands
        self._looked = float("-inf")
        self._running = False
        self._child: processes.Handle | None = None

    def look(self, reading: Reading, *, quiet: bool) -> None:
        """Begin the drill that is due, if this is the moment. To be called about once a second."""
        if not self.policy.drill_every_hours or not self.policy.drills or self._running:
            return
        now = asyncio.get_running_loop().time()
        if now - self._looked < LOOK_EVERY_S or not is_moment(reading, quiet=quiet):
            return
        self._looked = now
        self._running = True
        self._hands.begin(self._consider())

    async def stop(self) -> None:
        """End the drill that runs: the guard ends."""
        if self._child is not None:
            await self._hands.in_hand(self._child.kill_tree)

    async def _consider(self) -> None:
        try:
            told = await self._hands.in_hand(files.read_json, self._folders.calendar)
            last, number = _last(told.get("at")), told.get("number")
            now = dt.datetime.now().astimezone()
            if not is_due(now, last, self.policy.drill_every_hours, self.policy.drill_hour):
                return
            begun = number + 1 if isinstance(number, int) else 0
            fault = self.policy.drill_faults[begun % len(self.policy.drill_faults)]
            written = {"at": now.isoformat(timespec="seconds"), "number": begun, "fault": fault}
            await self._hands.in_hand(files.write_json, self._folders.calendar, written)
            await self._run(fault)
        except OSError as error:
            self._hands.note(
                "calendar", failed=error.strerror
            )  # it is tried again when it is looked at again
        finally:
            self._running = False

    async def _run(self, fault: str) -> None:
        self._hands.note("calendar", fault=fault)
        self._child = handle = await self._hands.in_hand(self._start, fault)
        ended = False
        try:
            ended = await processes.gone(handle, DRILL_S)
        finally:
            self._child = None
            if not ended:
                handle.kill_tree()
                await processes.gone(handle, lives.KILL_S)
            how = handle.reap()
            handle.close()
        self._hands.note("calendar", fault=fault, code=None if how is None else how.code)

    def _start(self, fault: str) -> processes.Handle:
        argv = [sys.executable, "-I", "-m", "hardcore.cli", "--data", str(self._folders.data), "drill", fault]
        argv += ["--yes", "--scheduled", "--json"]
        return processes.spawn(
            ["nice", "-n", NICE, *argv] if shutil.which("nice") else argv,
            lives.clean_environment(),
            logs.place(self._folders.logs / "drill.log", self._folders.run),
            self._folders.data,
        )


def _last(at: object) -> dt.datetime | None:
    try:
        last = dt.datetime.fromisoformat(str(at))
    except ValueError:
        return None
    return last if last.tzinfo is not None else None
