"""The hands of a switch: a spare is told to take over, a core is told to let go.

Both are words over the core's own control socket, under this guard's generation. To promote is the urgent one: its
order leaves within the turn of the loop in which the death was heard of, before any evidence and any file of the old
core is looked at; only then is the answer waited for. What comes of it is said on the notify socket, as at any start.
Until then nothing else is written: the fence waits for the same disk, and each fsync beside it makes it wait longer.
"""

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any

from hardcore.host import clock
from hardcore.host.core_control import Told
from hardcore.host.folders import Folders
from hardcore.host.lives import Life, as_words
from hardcore.host.steps import Steps
from hardcore.model import observations as seen
from hardcore.model.actions import Drain, Promote

#: A spare that runs answers in a millisecond; one that does not is none.
PROMOTE_S = 0.5
#: The core keeps the time of a drain itself; its answer may come this much later.
DRAIN_MORE_S = 0.5
#: What is not urgent waits this long for a switch to be over, and not longer: a slow proof must not cost evidence.
CALM_S = 1.0


class Handover:
    """Speaks to the two cores of a switch. `tell` takes the facts, on the loop."""

    def __init__(
        self, folders: Folders, generation: int, steps: Steps, tell: Callable[[seen.Observation], None]
    ) -> None:
        self._folders = folders
        self._generation = generation
        self._steps = steps
        self._tell = tell
        self._calm = asyncio.Event()
        self._calm.set()

    async def calm(self) -> None:
        """Wait until no spare is on its way to serving, or not much longer."""
        with suppress(TimeoutError):
            await asyncio.wait_for(self._calm.wait(), CALM_S)

    def over(self) -> None:
        """The switch has come to its end, whichever."""
        self._calm.set()

    def promote(self, life: Life, order: Promote) -> Coroutine[Any, Any, None]:
        """Tell the spare to take over, here and now; what is returned only waits for its answer."""
        self._calm.clear()
        life.spare = False
        self._steps.mark("promote", expected_epoch=order.expected_epoch, **life.named())
        words = {
            "verb": "promote",
            "expected_epoch": order.expected_epoch,
            "witnesses": as_words(order.witnesses),
            "busy_ms": order.busy_ms,
            "generation": self._generation,
        }
        return self._promoted(life, Told(self._folders.core_control(life.nonce), words))

    async def _promoted(self, life: Life, told: Told) -> None:
        """Only that it refuses, or says nothing, is worth telling."""
        answer = await told.answer(PROMOTE_S)
        if answer.refused:
            self.over()
            self._tell(seen.PromoteRefused(clock.now_ns(), life.number, answer.refused))

    async def drain(self, life: Life, order: Drain) -> None:
        """Have the core let go of the store. No answer is no fact: the manager's own deadline rings then."""
        self._steps.condemn(life.nonce)
        self._steps.mark("drain", life=life.number)
        words = {"verb": "drain", "within_ms": order.within_ms, "generation": self._generation}
        told = Told(self._folders.core_control(life.nonce), words)
        answer = await told.answer(order.within_ms / 1000 + DRAIN_MORE_S)
        if not answer.heard:
            return
        if answer.refused:
            self._steps.absolve(life.nonce)
            self._steps.hint("undrained")
        seq = answer.said.get("seq")
        told_seq = seq if isinstance(seq, int) and not isinstance(seq, bool) else 0
        done, why = not answer.refused, answer.refused
        self._tell(seen.Drained(clock.now_ns(), life.number, done=done, seq=told_seq, reason=why))
