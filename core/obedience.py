"""What this core does when its guard gives it an order: where it stands, take over, drain, reads only, drills.

The control socket is open before the book is, so an order may come too early, and then it is refused with a
sentence. A drill that is a command's fault becomes a command: it takes a slot, stands in the writer's line and
is noted like any other, so that whoever watches sees what a real one would show; no event comes of it.
"""

import asyncio
import logging
from collections.abc import Callable
from functools import partial
from time import monotonic_ns
from typing import Final

from core.checkpointing import Checkpointer
from core.draining import LEAVING, Drain
from core.guarded.control import CheckpointMade, RulesRead, Standing
from core.guarded.drills import AT_ONCE, BY_COMMAND, LEAK_BYTES_MAX, Drill, Leak
from core.guarded.orders import ComponentOrder, DrainOrder, DrillOrder, PromoteOrder, SafeOrder
from core.journal.answers import Done, Exercise, StoreBusy
from core.journal.writer import Writer
from core.parts import Parts
from core.rulings import Rulings
from core.safety import Safety
from core.service import Service
from core.slots import Draining, NoSlot
from core.warming import Spare

logger = logging.getLogger("core")

KIND: Final = "drill"
ACCOUNT: Final = "system:drill"
NOT_DONE: Final = 503
KNOCKS_MAX: Final = 60  # each waits for the lock as long as any batch would
NO_SPARE: Final = "This core is no spare."
NOT_OPEN: Final = "The core has not opened its book yet."


class Obedience:
    """Takes the orders of the control socket. All methods on the loop's thread."""

    def __init__(self, rulings: Rulings | None = None, memory_bytes: int | None = None) -> None:
        """Take orders from now on; most are refused until there is a book.

        `rulings`: what is read anew when told to. `memory_bytes`: the guard's limit, beyond which nothing is leaked.
        """
        self._rulings = rulings or Rulings()
        self._leak = Leak()
        self._leak_bytes_max = memory_bytes or LEAK_BYTES_MAX
        self.parts = Parts()  # the components, once there is a book
        self.checkpointer: Checkpointer | None = None  # of a book that is written to
        self.gone_by = ""  # the checkpoint that the start went by
        self._service: Service | None = None
        self._safety: Safety | None = None
        self._writer: Writer | None = None
        self._exercises: set[asyncio.Task[None]] = set()
        self._spare: Spare | None = None
        self._drain: Drain | None = None
        self._leaving = False
        self.build = ""  # the name of this code, once it is known

    def wait(self, spare: Spare) -> None:
        """Take the order by which this spare becomes the core."""
        self._spare = spare

    def leave(self) -> None:
        """Promote no more: the end of this process was asked for, or has come."""
        self._leaving = True

    def drain_with(self, drain: Drain) -> None:
        """Take orders to drain from now on."""
        self._drain = drain

    def serve(self, service: Service, safety: Safety, writer: Writer | None) -> None:
        """Take orders for this service from now on. `writer` None: the core was started to read only."""
        self._service, self._safety, self._writer = service, safety, writer

    def standing(self) -> Standing:
        """Return where the core stands."""
        if self._service is not None:
            now = self._service
            return Standing(
                now.epoch,
                now.head_seq,
                now.safe,
                build=self.build,
                drained=now.is_laid_down,
                checkpoint=self.gone_by,
            )
        if self._spare is not None:
            return Standing(0, self._spare.seq, spare=not self._spare.is_told, build=self.build)
        return Standing(0, 0, build=self.build)

    def promote(self, order: PromoteOrder) -> Callable[[], object] | str:
        """Return what has this spare take over once it is called, or why it can't."""
        if self._leaving:
            return LEAVING
        return NO_SPARE if self._spare is None else self._spare.promote(order)

    async def drain(self, order: DrainOrder) -> int | str:
        """Finish everything and let go of the store; return the last sequence, or why that could not be done."""
        return NOT_OPEN if self._drain is None else await self._drain.within(order.within_ms)

    async def read_rules(self) -> RulesRead | str:
        """Read the rules anew, and what is armed; return what is in force, or why those before them stay so."""
        fault = await asyncio.to_thread(self._rulings.read)
        self._rulings.word.heard()
        if fault is not None:
            logger.warning("The rules before stay in force. %s", fault.why)
            return fault.why
        rules = self._rulings.quarantine.rules
        return RulesRead(rules.serial, rules.count)

    async def restart_component(self, order: ComponentOrder) -> str | None:
        """End one component and begin it anew; return why that can't be done."""
        if self._leaving:
            return LEAVING
        refused = self.parts.begin_anew(order.name)
        if refused is None:
            logger.warning("The component %s was begun anew, as its guard has ordered.", order.name)
        return refused

    async def checkpoint(self) -> CheckpointMade | str:
        """Make a checkpoint; return the one that stands for the ledger now, or why there is none."""
        return NOT_OPEN if self.checkpointer is None else await self.checkpointer.make()

    async def switch_safe(self, order: SafeOrder) -> str | None:
        """Serve reads only, or everything again."""
        if self._safety is None:
            return NOT_OPEN
        return await self._safety.switch(order.reason if order.on else None)

    def drill(self, order: DrillOrder) -> Callable[[], object] | str:
        """Return what breaks the core once it is called, or why it can't be broken in this way now."""
        if order.drill in AT_ONCE:
            return AT_ONCE[order.drill]
        if order.drill is Drill.LEAK:
            return partial(self._leak.begin, order.mb_per_s, order.seconds, self._leak_bytes_max)
        if order.drill is Drill.STALL:
            return self.parts.stall(order.component)
        if self._service is None:
            return NOT_OPEN
        if self._writer is None:
            return "The core was started to read only: it has no writer to drill."
        command_id = self._service.new_id()
        slot = self._service.begin(
            KIND, b"", command_id=command_id, transaction_id=command_id, account_ids=(ACCOUNT,)
        )
        if isinstance(slot, NoSlot):
            return "Every slot is taken: there is none for the drill."
        if isinstance(slot, Draining):
            return LEAVING
        work = Exercise(slot, command_id, ACCOUNT, BY_COMMAND[order.drill])
        return partial(self._begin, order, work, self._service, self._writer)

    def _begin(self, order: DrillOrder, work: Exercise, service: Service, writer: Writer) -> None:
        if order.drill is Drill.DISKFULL:
            writer.pretend_full(monotonic_ns() + order.seconds * 1_000_000_000)
        knocks = KNOCKS_MAX if order.drill is Drill.DBLOCK else 1
        task = asyncio.get_running_loop().create_task(_exercise(work, service, writer, knocks), name=KIND)
        self._exercises.add(task)
        task.add_done_callback(self._exercises.discard)


async def _exercise(work: Exercise, service: Service, writer: Writer, knocks: int) -> None:
    """Stand in the writer's line with a drill, and give its slot back should it ever end.

    At a store that somebody else has locked it knocks so often before it takes no for an answer.
    """
    transaction_id, account_id = work.transaction_id, work.account_id  # noqa: F841  for whoever asks for tasks
    answer = await writer.submit(work)
    while isinstance(answer, StoreBusy) and (knocks := knocks - 1):
        answer = await writer.submit(work)
    service.finish(work.slot, answer.status if isinstance(answer, Done) else NOT_DONE)
