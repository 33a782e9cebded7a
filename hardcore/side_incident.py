"""An incident beside whatever the core does: opened, filled and closed by whoever watches something else.

The manager tells the story of the core and knows nothing of this one; two stories at one time are two folders. It is
written by the same hands as the manager's (`snapshot/filing`), in the same form, so that everything that reads
incidents reads these as well. A story that is open when the guard ends is closed by the next guard, like any other.
"""

import asyncio
from collections.abc import Coroutine, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol

import msgspec

from hardcore.host import clock
from hardcore.host.folders import Folders
from hardcore.host.ids import new_id
from hardcore.model import actions as orders
from hardcore.model.observations import Exit
from hardcore.model.verdicts import Diagnosis, Grade, Testimony
from hardcore.snapshot import writer
from hardcore.snapshot.filing import Filing
from hardcore.snapshot.subject import Evidence, Subject, Tools

#: Deaths that one story names; what dies on is told by the last of them.
DEATHS_MAX = 64


class Hands(Protocol):
    """What is needed of the executor around it."""

    pool: ThreadPoolExecutor
    tools: Tools
    filing: Filing

    def begin(self, work: Coroutine[Any, Any, object]) -> None:
        """Start a piece of work that nobody waits for."""

    def carry_out(self, action: orders.Action) -> None:
        """Begin to carry out one order."""

    def note(self, kind: str, **particulars: object) -> None:
        """Write a line to the guard's log; nothing waits for it."""


class Loss(msgspec.Struct, frozen=True):
    """What was found. Times are monotonic; `fault_ns` is the last sign of life, as far as anybody can tell."""

    diagnosis: Diagnosis
    grade: Grade
    evidence: tuple[Testimony, ...]
    fault_ns: int
    detected_ns: int
    drill: str | None = None


class _Story(msgspec.Struct):
    id: str
    loss: Loss
    alerts: bool
    steps: list[tuple[str, int]]
    deaths: list[orders.DeathNote] = msgspec.field(default_factory=list)
    taken: list[asyncio.Event] = msgspec.field(
        default_factory=list
    )  # each is set when a piece of its evidence is there


class SideIncident:
    """One story at a time."""

    def __init__(self, hands: Hands, folders: Folders) -> None:
        self._hands = hands
        self._folders = folders
        self._story: _Story | None = None
        self.last: str | None = None  # the one that was closed last

    @property
    def id(self) -> str | None:
        """The open incident, if one is."""
        return self._story.id if self._story is not None else None

    def has(self, step: str) -> bool:
        """Return whether a step has been told in the open story."""
        return self._story is not None and any(name == step for name, _ in self._story.steps)

    def open(self, loss: Loss, *, alerts: bool, text: str) -> None:
        """Begin a story; within one that is open nothing new begins."""
        if self._story is not None:
            return
        steps = [("fault", loss.fault_ns), ("detected", loss.detected_ns)]
        self._story = _Story(new_id(), loss, alerts, steps)
        self._alert(orders.AlertStage.OPENED, text)
        self._keep_open()

    def step(self, name: str, at_ns: int) -> None:
        """Tell a step of the story, if one is open."""
        if self._story is not None:
            self._story.steps.append((name, at_ns))

    def died(self, at_ns: int, how: Exit | None) -> None:
        """Tell a death."""
        if self._story is not None and len(self._story.deaths) < DEATHS_MAX:
            self._story.deaths.append(orders.DeathNote(at_ns, self._story.loss.diagnosis, how))

    async def take(
        self, pid: int, pidfd: int, budget_ms: int, *, living: bool, found: Mapping[str, bytes]
    ) -> None:
        """Take the evidence of a process; what hinders it is told in the story's folder and in the log."""
        story = self._story
        if story is None:
            return
        done = asyncio.Event()
        story.taken.append(done)
        subject = Subject(
            pid=pid,
            pidfd=pidfd,
            nonce="",
            recorder=self._folders.gateway_page,
            logs=(self._folders.logs / "gateway.log",),
            incident=story.id,
            incidents=self._folders.incidents,
            data=self._folders.data,
            shelter=self._folders.shelter,
        )
        hands = self._hands
        try:
            taken = await writer.take_gateway(
                subject, budget_ms, hands.pool, hands.tools, living=living, found=found
            )
            if not isinstance(taken, Evidence):
                hands.note("evidence", incident=story.id, missing=taken.reason, kept=taken.kept.value)
                hands.filing.lose(story.id, taken)
            elif living:
                story.steps.append(("dumped", clock.now_ns()))
        finally:
            done.set()

    def waits(self, text: str) -> None:
        """Nothing goes on by itself: a person is needed."""
        self._alert(orders.AlertStage.WAITS, text)

    def close(self, outcome: str, at_ns: int, text: str) -> None:
        """End the story and have its facts and its report written."""
        story = self._story
        if story is None:
            return
        story.steps.append(("closed", at_ns))
        steps = dict(story.steps)
        outage_ms = (steps["serving"] - steps["fault"]) // 1_000_000 if "serving" in steps else None
        self._alert(orders.AlertStage.CLOSED, text, outcome, outage_ms)
        self._story, self.last = None, story.id
        told = _incident(story, outcome, at_ns)
        self._hands.begin(self._hands.filing.close(told, None, "", story.taken))

    def _keep_open(self) -> None:
        assert self._story is not None, "just begun"
        told = _incident(self._story, "open", 0)
        self._hands.begin(self._hands.filing.open(told, None, "", ()))

    def _alert(
        self, stage: orders.AlertStage, text: str, outcome: str = "", outage_ms: int | None = None
    ) -> None:
        story = self._story
        if story is None or not story.alerts:
            return
        self._hands.carry_out(orders.Alert(story.loss.diagnosis, text, story.id, stage, outcome, outage_ms))


def _incident(story: _Story, outcome: str, closed_ns: int) -> orders.Incident:
    """Return the story in the form of every incident: of a core there is nothing to tell."""
    loss = story.loss
    return orders.Incident(
        id=story.id,
        opened_ns=loss.detected_ns,
        diagnosis=loss.diagnosis,
        grade=loss.grade,
        evidence=loss.evidence,
        planned=False,
        drill=loss.drill,
        reason="",
        life=-1,
        epoch=0,
        exit=None,
        last_words=None,
        in_flight=(),
        suspects=(),
        timeline=tuple(story.steps),
        deaths=tuple(story.deaths),
        requests=(),
        proof=None,
        witness=None,
        next_epoch=None,
        audit=None,
        outcome=outcome,
        waits_for=None,
        closed_ns=closed_ns,
    )
