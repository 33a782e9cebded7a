"""The checkpointer: makes a checkpoint of the book now and then, while others are served.

Each is a quick proof from the one before to the head, in slices with rests, and a file of some hundred bytes; nothing of
it is in the writer's way. Where nothing was committed since, the last one stands. A book that turns out not to be whole
is told like any other proof of that. What the disk does not take is tried again at the next turn: a start without a
checkpoint has more to hash, and nothing else. It is a component: where it hangs it is begun anew, and what was left
behind writes nothing any more. Not chosen: to make one within the writer's batches, where the head is known
for certain; a proof has no business in the one place that everybody waits for.
"""

import asyncio
import logging
import threading
import time
from collections.abc import Awaitable, Callable
from typing import Final

import msgspec
from sqlalchemy import Engine

from core import departure
from core.alone import Turns
from core.guarded.control import CheckpointMade
from core.guarded.recorder import FlightRecorder
from core.journal import checkpoint
from core.journal.chain import Broken
from core.journal.checkpoints import Checkpoints
from core.journal.ground import Ground
from core.journal.quick import Quick, prove_quickly
from core.journal.rebuilding import Rebuilding
from core.journal.store import StoreError, beside
from core.journal.verify import GivenUp
from core.settings import Settings

CHECKPOINT_S: Final = 60
CHECKPOINTER: Final = "checkpointer"  # its name on the recorder page
SILENT_MS_MAX: Final = 30_000  # for a slice, or for a slow disk to take the file

logger = logging.getLogger("core")


class Checkpointer:
    """The component: makes the checkpoints of one life. All methods on the loop's thread."""

    def __init__(
        self,
        checkpoints: Checkpoints,
        readers: Engine,
        recorder: FlightRecorder,
        settings: Settings,
        rebuilding: Rebuilding,
        head_seq: Callable[[], int],
        on_unsound: Callable[[str], object],
        leaving: threading.Event,
    ) -> None:
        """Prepare. `on_unsound` is told the sentence where the book is not whole; `leaving`: give up what is at work."""
        self._checkpoints = checkpoints
        self._readers = beside(readers)
        self._settings = settings
        self._rebuilding = rebuilding
        self._head_seq = head_seq
        self._on_unsound = on_unsound
        self._leaving = leaving
        self._ground = Ground(checkpoints)
        self._turns = Turns(CHECKPOINTER, recorder.component(CHECKPOINTER, SILENT_MS_MAX))
        self._turn = asyncio.Lock()
        self._drills: set[asyncio.Task[object]] = set()
        self._last: CheckpointMade | None = None
        self._at_work: asyncio.Task[CheckpointMade | str] | None = None

    @property
    def last(self) -> CheckpointMade | None:
        """The newest one that this life has made."""
        return self._last

    async def keep_making(self, every_s: int) -> None:
        """Make one in every so many seconds in which something was committed, until this is cancelled."""
        await self._tried(self._sweep)
        while True:
            await asyncio.sleep(every_s)
            await self._tried(self.make)

    async def _tried(self, step: Callable[[], Awaitable[CheckpointMade | str | None]]) -> None:
        try:
            made = await step()
        # Whatever is wrong with this turn, a mistake of ours included, is no reason to have no checkpoint ever again.
        except Exception:
            logger.exception("No checkpoint was made, at a mistake of our own")
        else:
            if isinstance(made, str):
                logger.warning("No checkpoint was made. %s", made)

    async def _sweep(self) -> None:
        await self._turns.do(lambda _: self._checkpoints.sweep())

    async def make(self) -> CheckpointMade | str:
        """Return the checkpoint that stands for the book after this call, or why there is none."""
        async with self._turn:
            if self._last is not None and self._last.seq == self._head_seq():
                return self._last
            self._at_work = asyncio.create_task(self._turns.do(self._make), name=CHECKPOINTER)
            made = await asyncio.shield(self._at_work)
            if isinstance(made, CheckpointMade):
                self._last = made
            return made

    def begin_anew(self) -> None:
        """Leave one that hangs behind; it is made anew for whoever waits."""
        self._turns.begin_anew()

    def stall(self) -> None:
        """Have the making of one come to no end, where it holds nothing of the store: a drill."""
        self._turns.stall()
        if not self._turns.is_busy:
            task = asyncio.create_task(self._turns.do(self._make), name=CHECKPOINTER)
            self._drills.add(task)
            task.add_done_callback(self._drills.discard)

    async def end(self) -> None:
        """Wait until none is being made, once this core leaves: who reads the store keeps it from being closed."""
        if self._at_work is not None:
            await asyncio.wait({self._at_work})

    def _make(self, go_on: Callable[[], None]) -> CheckpointMade | str:
        rest_s = self._settings.verify_rest_ms / 1000

        def between_slices() -> bool:
            go_on()
            return self._leaving.wait(rest_s)

        found = prove_quickly(
            self._readers,
            self._settings.read_ms_max,
            self._settings.tail_events,
            self._ground,
            between_slices,
            self._rebuilding,
        )
        go_on()  # raises in one that was left behind: another makes it
        match found:
            case Quick():
                return self._keep(found)
            case Broken():
                sentence = departure.corrupt(found.sentence).sentence
                self._on_unsound(sentence)
                return sentence
            case StoreError():
                return f"The ledger can't be read now ({found.text})."
            case GivenUp():
                return "The core is leaving."

    def _keep(self, proven: Quick) -> CheckpointMade | str:
        if proven.attested.seq == 0:
            return "The ledger is empty: there is nothing to keep."
        if not proven.grounded:
            return "Nothing of this ledger was attested yet, so its balances can't be held against anything."
        data = checkpoint.made(proven.attested, proven.epoch, proven.sums, proven.accounts, time.time_ns())
        name = checkpoint.name_of(proven.attested.seq, proven.epoch)
        try:
            self._checkpoints.keep(name, data)
        except OSError as error:
            return f"It could not be written ({error.strerror})."
        self._ground = msgspec.structs.replace(self._ground, known=proven.attested)
        return CheckpointMade(name, proven.attested.seq)
