"""What is written of an incident: what is known while it is open, its facts, what comes late, the report.

All of it waits for disks and may fail, so it is tried again with pauses as long as the guard lives; for one
incident one thing at a time, so that a report never tells of less than its facts. What the disk of the incidents
does not take waits in a shelter, evidence as well as facts, so that the next guard finds it too. Nothing of the
recovery waits for any of this.
"""

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from itertools import repeat
from pathlib import Path
from typing import Any, Protocol
from weakref import WeakValueDictionary

from hardcore.host import clock
from hardcore.model.actions import AddAudit, Incident
from hardcore.model.observations import RequestOutcome, RequestsSettled
from hardcore.model.trials import AddTrials
from hardcore.model.verdicts import Diagnosis
from hardcore.snapshot import storing, writer
from hardcore.snapshot.facts import audit, facts, in_the_middle, requests, trials
from hardcore.snapshot.form import as_bytes
from hardcore.snapshot.storing import BundleFailed
from hardcore.snapshot.subject import EvidenceFailed, Kept

#: Pauses before what could not be written is tried again; the last one again and again.
RETRY_PAUSES_S = (1.0, 5.0, 30.0, 120.0, 600.0)
#: Closed incidents whose late requests wait at one time.
LATE_INCIDENTS_MAX = 64
#: Pieces that wait for a disk longer than all pauses; more are given up.
WAITING_MAX = 64
#: What a lost guard has left is told with its gateway's fate, if that is known within this.
GATEWAY_S = 30.0


def went_on(told: Mapping[str, Any]) -> bool:
    """Whether an incident ended well and its core served all the while."""
    return told["outcome"] == "recovered" and told["outage_ms"] is None and not told["deaths"]


class Hands(Protocol):
    """What filing needs of the executor around it."""

    halted: asyncio.Event

    async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
        """Run blocking work on a hand's thread."""

    def note(self, kind: str, **particulars: object) -> None:
        """Write a line to the guard's log."""


class Filing:
    """Files the incidents of one guard.

    `report` has the report of a folder made and returns then; `ran` says which code, schema and policy an incident met.
    """

    def __init__(
        self,
        incidents: Path,
        hands: Hands,
        report: Callable[[Path], Awaitable[None]],
        pauses_s: Sequence[float] = RETRY_PAUSES_S,
        shelter: Path | None = None,
        ran: Callable[[Incident], Mapping[str, object]] = lambda _: {},
    ) -> None:
        self._incidents = incidents
        self._hands = hands
        self._report = report
        self._pauses_s = pauses_s
        self._shelter = shelter
        self._ran = ran
        self._going_on: dict[str, dict[str, Any]] = {}
        self._lost: dict[str, EvidenceFailed] = {}
        self._trials: dict[str, list[dict[str, Any]]] = {}  # of incidents that are open
        self._waiting = 0
        self._locks: WeakValueDictionary[str, asyncio.Lock] = WeakValueDictionary()
        self._late: dict[str, list[RequestOutcome]] = {}
        self._stopped: deque[str] = deque(maxlen=writer.STOPPED_MAX)
        self._looked = False
        self._inherited = asyncio.Event()  # what a dead guard left has been gone through once
        self._inherited.set()
        #: The incident in which people waited when the guard before this one ended; empty: nobody did.
        self.left_open = ""
        self._gateway = asyncio.Event()
        self._gateway.set()
        self._held_ms: int | None = None  # how long requests met no gateway before this guard had one

    def lose(self, incident_id: str, failed: EvidenceFailed) -> None:
        """Remember until an incident is closed that evidence of it is not on its disk, and why."""
        if failed.kept is not Kept.ELSEWHERE and len(self._lost) < LATE_INCIDENTS_MAX:
            self._lost.setdefault(incident_id, failed)

    async def open(
        self, incident: Incident, pid: int | None, nonce: str, after: Sequence[asyncio.Event]
    ) -> None:
        """Write down what is known of an incident that goes on, until it is done or there is more to tell.

        `after`: its evidence, which comes first. Nothing waits for this, least of all the closing.
        """
        told = self._going_on[incident.id] = facts(incident, pid, nonce, clock.wall, self._ran(incident))
        for evidence in after:
            await evidence.wait()
        pauses, folder = self._pauses(), self._incidents / incident.id
        while True:
            async with self._alone(
                incident.id
            ):  # and not while it pauses: the closing does not wait for a disk
                if self._going_on.get(incident.id) is not told:
                    return
                failed = await self._hands.in_hand(writer.write_opening, folder, told)
            pause_s = next(pauses, None)
            if failed is None or pause_s is None or self._hands.halted.is_set():
                return
            await _first(self._hands.halted, pause_s)

    async def close(
        self, incident: Incident, pid: int | None, nonce: str, after: Sequence[asyncio.Event]
    ) -> None:
        """Write the facts of an incident, let go of the oldest ones, and have its report made.

        `after`: its evidence, which comes first.
        """
        self._going_on.pop(incident.id, None)
        if incident.outcome == "manual":
            self._stopped.append(incident.id)
        told = facts(incident, pid, nonce, clock.wall, self._ran(incident))
        if self.left_open and incident.diagnosis is Diagnosis.SENTINEL_LOST:
            told = in_the_middle(told, self.left_open)
        elif incident.diagnosis is Diagnosis.SENTINEL_LOST and went_on(told):
            told = {**told, "outage_ms": await self._held()}  # its core served on; did its gateway?
        folder = self._incidents / incident.id
        tried = self._trials.pop(incident.id, None)
        told = told if tried is None else {**told, "trials": tried}
        async with self._alone(incident.id):
            for evidence in after:
                await evidence.wait()
            lost = self._lost.pop(incident.id, None)
            if not await self._persist(incident.id, self._write_facts, folder, told):
                return
            self._hands.note(
                "incident", id=incident.id, diagnosis=incident.diagnosis, outcome=incident.outcome
            )
            removed = await self._hands.in_hand(writer.prune, self._incidents, incident.id)
            if removed:
                self._hands.note("incidents", removed=removed)
            failed = await self._bring_home(incident.id)
            missing = {} if lost is None else {storing.LOST: lost.reason}
            if failed is not None:
                missing[storing.WAITING] = failed.reason
            if missing:
                late = lost is not None and lost.kept is Kept.PERHAPS
                await self._hands.in_hand(storing.say_missing, folder, missing, late)
            await self._have_report(folder)
        if failed is not None:
            await self._bring_home_later(incident.id)

    def gateway_is_awaited(self) -> None:
        """The guard before was lost: whether its gateway goes on will be told by `gateway_is_back`."""
        self._gateway.clear()

    def gateway_is_back(self, held_ms: int | None) -> None:
        """There is a gateway; `held_ms`: for so long there was none, None: it is the one of the guard before."""
        self._held_ms = held_ms
        self._gateway.set()

    async def _held(self) -> int | None:
        """Return for how long there was no gateway; where it is still missing after a while, how long so far."""
        waits = [asyncio.ensure_future(one.wait()) for one in (self._gateway, self._hands.halted)]
        since_ns = clock.now_ns()
        await asyncio.wait(waits, timeout=GATEWAY_S, return_when=asyncio.FIRST_COMPLETED)
        for one in waits:
            one.cancel()
        return self._held_ms if self._gateway.is_set() else (clock.now_ns() - since_ns) // 1_000_000

    def _write_facts(self, folder: Path, told: Mapping[str, Any]) -> BundleFailed | None:
        failed = writer.write_facts(folder, told)
        if failed is not None and self._shelter is not None:
            storing.shelter_facts(self._shelter, folder.name, as_bytes(told))  # else memory alone has them
        return failed

    async def _bring_home(self, incident_id: str) -> BundleFailed | None:
        """Move what waits in the shelter into its incident; return why that can't be done."""
        if self._shelter is None:
            return None
        failed: BundleFailed | None = await self._hands.in_hand(
            storing.bring_home, self._shelter, self._incidents, incident_id
        )
        return failed

    async def _bring_home_later(self, incident_id: str) -> None:
        for pause_s in self._pauses():
            await _first(self._hands.halted, pause_s)
            if self._hands.halted.is_set():
                return
            async with self._alone(incident_id):
                if await self._bring_home(incident_id) is None:
                    await self._have_report(self._incidents / incident_id)
                    return

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

    async def add_trials(self, order: AddTrials) -> None:
        """Write what came of an incident's trials: into its facts where it is closed, else with them."""
        told = trials(order.trials)
        if order.incident in self._going_on:
            self._trials[order.incident] = told
            return
        if not writer.is_id(order.incident):
            return
        folder = self._incidents / order.incident
        async with self._alone(order.incident):
            if await self._persist(order.incident, writer.add_trials, folder, told):
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
            await self._inherited.wait()
            stopped += await self._hands.in_hand(writer.find_stopped, self._incidents)
        for incident_id in dict.fromkeys(stopped):
            folder = self._incidents / incident_id
            async with self._alone(incident_id):  # its facts are there, if they can be
                if await self._persist(incident_id, writer.add_served, folder, clock.wall(at_ns)):
                    await self._have_report(folder)

    async def close_abandoned(
        self, found: Sequence[writer.Abandoned], known: Mapping[str, Any] | None = None
    ) -> None:
        """Close what a dead guard left open: each gets closing facts and a report, or is removed; and make the reports
        that are missing of what it had closed.

        `known`: what that guard had noted beside its last deed, of the one among them that it was dealing with.
        """
        self._inherited.clear()
        try:
            await self._hands.in_hand(writer.sweep, self._incidents)
            unreported = await self._hands.in_hand(writer.find_unreported, self._incidents)
            left, pauses = await self._close_each(found, known), self._pauses()
        finally:
            self._inherited.set()
        for folder in unreported:
            async with self._alone(folder.name):  # one that is being closed now gets its own
                if await self._hands.in_hand(writer.is_unreported, folder):
                    await self._have_report(folder)
        while left:
            pause_s = next(pauses, None)
            if pause_s is None or self._hands.halted.is_set():
                return
            await _first(self._hands.halted, pause_s)
            left = await self._close_each(left, known)

    async def _close_each(
        self, found: Sequence[writer.Abandoned], known: Mapping[str, Any] | None
    ) -> list[writer.Abandoned]:
        noted = known or {}
        return [
            one
            for one in found
            if not await self._close_one(one, noted if noted.get("id") == one.id else None)
        ]

    async def _close_one(self, one: writer.Abandoned, known: Mapping[str, Any] | None) -> bool:
        failed = await self._bring_home(one.id)
        if failed is not None:
            self._hands.note("incident", id=one.id, failed=failed.reason)
            return False
        path = await self._hands.in_hand(writer.close_abandoned, one, clock.wall(clock.now_ns()), known)
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
        """Do the writing until it is done; when the guard ends, once more, and then no longer."""
        pauses = self._pauses()
        if self._waiting >= WAITING_MAX:
            pauses = iter(())
        self._waiting += 1
        try:
            while (failed := await self._hands.in_hand(work, *args)) is not None:
                self._hands.note("incident", id=incident_id, failed=failed.reason)
                pause_s = next(pauses, None)
                if pause_s is None or self._hands.halted.is_set():
                    return False
                await _first(self._hands.halted, pause_s)
        finally:
            self._waiting -= 1
        return True

    def _pauses(self) -> Iterator[float]:
        yield from self._pauses_s
        if self._pauses_s:
            yield from repeat(self._pauses_s[-1])


async def _first(event: asyncio.Event, pause_s: float) -> None:
    try:
        await asyncio.wait_for(event.wait(), pause_s)
    except TimeoutError:
        return
