"""What is written of an incident after its last word: facts, what comes late, the report, and how much is kept.

All of it waits for disks and may fail, so it is tried again with pauses while the guard lives; for one
incident one thing at a time, so that a report never tells of less than its facts. Nothing of the recovery
waits for any of this.
"""

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any, Protocol
from weakref import WeakValueDictionary

from hardcore.host import clock
from hardcore.model.actions import AddAudit, Incident
from hardcore.model.observations import RequestOutcome, RequestsSettled
from hardcore.snapshot import writer
from hardcore.snapshot.facts import audit, facts, requests

#: Pauses before facts that could not be written are tried again.
RETRY_PAUSES_S = (1.0, 5.0, 30.0, 120.0, 600.0)
#: Closed incidents whose late requests wait at one time.
LATE_INCIDENTS_MAX = 64


class Hands(Protocol):
    """What filing needs of the executor around it."""

    halted: asyncio.Event

    async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
        """Run blocking work on a hand's thread."""

    def note(self, kind: str, **particulars: object) -> None:
        """Write a line to the guard's log."""


class Filing:
    """Files the incidents of one guard. `report` has the report of a folder made and returns then."""

    def __init__(
        self,
        incidents: Path,
        hands: Hands,
        report: Callable[[Path], Awaitable[None]],
        pauses_s: Sequence[float] = RETRY_PAUSES_S,
    ) -> None:
        self._incidents = incidents
        self._hands = hands
        self._report = report
        self._pauses_s = pauses_s
        self._locks: WeakValueDictionary[str, asyncio.Lock] = WeakValueDictionary()
        self._late: dict[str, list[RequestOutcome]] = {}
        self._stopped: deque[str] = deque(maxlen=writer.STOPPED_MAX)
        self._looked = False

    async def close(
        self, incident: Incident, pid: int | None, nonce: str, after: Sequence[asyncio.Event]
    ) -> None:
        """Write the facts of an incident, let go of the oldest ones, and have its report made.

        `after`: its evidence, which comes first.
        """
        if incident.outcome == "manual":
            self._stopped.append(incident.id)
        told = facts(incident, pid, nonce, clock.wall)
        folder = self._incidents / incident.id
        async with self._alone(incident.id):
            for evidence in after:
                await evidence.wait()
            if not await self._persist(incident.id, writer.write_facts, folder, told):
                return
            self._hands.note(
                "incident", id=incident.id, diagnosis=incident.diagnosis, outcome=incident.outcome
            )
            removed = await self._hands.in_hand(writer.prune, self._incidents, incident.id)
            if removed:
                self._hands.note("incidents", removed=removed)
            await self._have_report(folder)

    async def add_late(self, fact: RequestsSettled) -> None:
        """Add requests that settled after their incident was closed; many lines become few reports."""
        first = fact.incident not in self._late
        if first and (len(self._late) >= LATE_INCIDENTS_MAX or not writer.is_id(fact.incident)):
            return
        waiting = self._late.setdefault(fact.incident, [])
        waiting += fact.requests[: max(0, writer.REQUESTS_MAX - len(waiting))]
        if not first:
            return
        folder = self._incidents / fact.incident
        async with self._alone(fact.incident):
            told = requests(self._late.pop(fact.incident))
            if told and await self._persist(fact.incident, writer.add_requests, folder, told):
                await self._have_report(folder)

    async def add_audit(self, order: AddAudit) -> None:
        """Add what the proof of the whole ledger said after the incident was closed."""
        folder = self._incidents / order.incident
        told = audit(order.audit, clock.wall)
        async with self._alone(order.incident):
            if await self._persist(order.incident, writer.add_audit, folder, told):
                await self._have_report(folder)

    async def add_recording(self, incident_id: str, write: Callable[[], bytes]) -> None:
        """Put the guard's own recording beside the facts, in place of what was there of it."""
        folder = self._incidents / incident_id
        async with self._alone(incident_id):
            await self._persist(incident_id, writer.add_recording, folder, write)

    async def served_again(self, at_ns: int) -> None:
        """Tell the incidents in which recovery had stopped, an earlier guard's too, that a core serves again."""
        stopped, looked = list(self._stopped), self._looked
        self._stopped.clear()
        self._looked = True
        if not looked:
            stopped += await self._hands.in_hand(writer.find_stopped, self._incidents)
        for incident_id in dict.fromkeys(stopped):
            folder = self._incidents / incident_id
            async with self._alone(incident_id):  # its facts are there, if they can be
                if await self._persist(incident_id, writer.add_served, folder, clock.wall(at_ns)):
                    await self._have_report(folder)

    async def close_abandoned(self, found: Sequence[writer.Abandoned]) -> None:
        """Close what a dead guard left open: each gets closing facts and a report, or is removed."""
        await self._hands.in_hand(writer.sweep, self._incidents)
        left = list(found)
        for pause_s in (*self._pauses_s, None):
            left = [one for one in left if not await self._close_one(one)]
            if not left or pause_s is None or self._hands.halted.is_set():
                return
            await _first(self._hands.halted, pause_s)

    async def _close_one(self, one: writer.Abandoned) -> bool:
        path = await self._hands.in_hand(writer.close_abandoned, one, clock.wall(clock.now_ns()))
        if isinstance(path, Path):
            self._hands.note("incident", id=one.id, abandoned=True)
            await self._have_report(path)
            return True
        self._hands.note("incident", id=one.id, removed=path is None, failed=getattr(path, "reason", None))
        return path is None

    async def _have_report(self, folder: Path) -> None:
        try:
            await self._report(folder)
        except OSError as error:
            self._hands.note("incident", id=folder.name, no_report=error.strerror)

    def _alone(self, incident_id: str) -> asyncio.Lock:
        return self._locks.setdefault(incident_id, asyncio.Lock())

    async def _persist(self, incident_id: str, work: Callable[..., Any], *args: Any) -> bool:
        """Do the writing until it is done or the pauses are used up; when the guard ends, once more."""
        for pause_s in (*self._pauses_s, None):
            last = pause_s is None or self._hands.halted.is_set()
            failed = await self._hands.in_hand(work, *args)
            if failed is None:
                return True
            self._hands.note("incident", id=incident_id, failed=failed.reason)
            if last:
                return False
            await _first(self._hands.halted, pause_s or 0.0)
        return False


async def _first(event: asyncio.Event, pause_s: float) -> None:
    try:
        await asyncio.wait_for(event.wait(), pause_s)
    except TimeoutError:
        return
