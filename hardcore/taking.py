"""Takes the evidence of a core as ordered, and knows for which incident some is under way.

It stands between the orders and `snapshot`: whose evidence it is, whether that core has to be stopped for it, what comes
of it as a fact. The killing is another's, and so is what is written of an incident; both wait for what is kept here.
"""

import asyncio
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol

from hardcore.host import clock
from hardcore.host.folders import Folders
from hardcore.host.lives import Life
from hardcore.host.steps import Steps
from hardcore.model import observations as seen
from hardcore.model.actions import TakeEvidence
from hardcore.senses import Senses
from hardcore.snapshot import writer
from hardcore.snapshot.filing import Filing
from hardcore.snapshot.image import ImageLimits
from hardcore.snapshot.subject import Evidence, Subject, Tools


class Hands(Protocol):
    """What is needed of the executor around it."""

    pool: ThreadPoolExecutor
    tools: Tools
    senses: Senses
    filing: Filing
    steps: Steps

    async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
        """Run blocking work on a hand's thread."""

    def note(self, kind: str, **particulars: object) -> None:
        """Write a line to the guard's log."""


class Taking:
    """Takes evidence. `tell` takes the facts; `calm` waits for a switch to be over; `image`: what a memory image may cost."""

    def __init__(
        self,
        hands: Hands,
        folders: Folders,
        tell: Callable[[seen.Observation], None],
        calm: Callable[[], Awaitable[None]],
        image: Callable[[], ImageLimits | None],
    ) -> None:
        self._hands = hands
        self._folders = folders
        self._tell = tell
        self._calm = calm
        self._image = image
        self._under_way: dict[str, list[asyncio.Event]] = {}

    def of(self, incident: str) -> list[asyncio.Event]:
        """Return what evidence of an incident was ordered so far; each is set when it is taken."""
        return list(self._under_way.get(incident, ()))

    def close(self, incident: str) -> list[asyncio.Event]:
        """As `of`, of an incident for which nothing more will be ordered."""
        return self._under_way.pop(incident, [])

    async def take(self, order: TakeEvidence, life: Life | None, done: asyncio.Event) -> None:
        """Take the evidence of this life, and tell what came of it."""
        try:
            await self._take(order, life)
        finally:
            done.set()

    def begun(self, incident: str) -> asyncio.Event:
        """Note that evidence of an incident was ordered; return what is to be set when it is taken."""
        done = asyncio.Event()
        self._under_way.setdefault(incident, []).append(done)
        return done

    async def _take(self, order: TakeEvidence, life: Life | None) -> None:
        if life is None or life.handle is None:
            nothing = seen.EvidenceTaken(
                clock.now_ns(), order.life, complete=False, page=None, stopped=order.stop
            )
            self._tell(nothing)
            return
        subject = self._subject(order, life, life.handle.pid, life.handle.pidfd)
        if order.living:
            if order.stop:
                self._hands.steps.condemn(life.nonce)
                await self._hands.in_hand(self._hands.steps.mark, "stop")
            taken = await writer.take_live(
                subject,
                order.budget_ms,
                self._hands.pool,
                self._hands.tools,
                stop=order.stop,
                image=self._image() if order.image else None,
            )
        else:
            await self._calm()
            taken = await writer.take_dead(subject, order.budget_ms, self._hands.pool, life.sample)
        if not isinstance(taken, Evidence):
            self._hands.note("evidence", incident=order.incident, missing=taken.reason, kept=taken.kept.value)
            self._hands.filing.lose(order.incident, taken)
        self._tell(
            seen.EvidenceTaken(
                clock.now_ns(),
                order.life,
                complete=isinstance(taken, Evidence) and taken.complete,
                page=taken.page,
                steps=taken.steps,
                stopped=order.stop,
            )
        )

    def _subject(self, order: TakeEvidence, life: Life, pid: int, pidfd: int) -> Subject:
        return Subject(
            pid=pid,
            pidfd=pidfd,
            nonce=life.nonce,
            recorder=self._folders.recorder(life.nonce),
            logs=(life.log or self._folders.logs / "core.log",),
            incident=order.incident,
            incidents=self._folders.incidents,
            data=self._folders.data,
            control=self._folders.core_control(life.nonce),
            first_stacks=self._hands.senses.first_stacks(life.number),
            shelter=self._folders.shelter,
        )
