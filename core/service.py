"""The service: between a request and the book, what every request needs and no protocol knows about.

It gives each piece of work its slot on the recorder before it may run, its ids, its place in the writer's line
or a reader's thread, and it knows when the core is leaving. No slot, no execution: the number of slots is the
bound of every queue behind this room. It lives on the event loop's thread. What takes no slot is a component with a
beat and a bound of its own (`auditor.py`).
"""

import asyncio
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Final, TypeVar

import msgspec
from sqlalchemy import Connection, Engine
from sqlalchemy.exc import DBAPIError

from core.admission import Admission, Wish
from core.auditor import Auditor
from core.exporter import Exporter
from core.guarded.naming import ids_shown
from core.guarded.poison import name_of
from core.guarded.recorder import FlightRecorder, Stage
from core.hub import Hub
from core.journal import queries
from core.journal.answers import (
    Answer,
    Done,
    Each,
    Exercise,
    KeyRow,
    KeyTaken,
    KeyUnknown,
    LookUp,
    Order,
    Orders,
    OutcomeUnknown,
    ReadOnly,
    Refused,
    found,
    repeated,
)
from core.journal.shelf import epoch_of, fetch_keys, read_key
from core.journal.store import StoreError, is_interrupted, snapshot, store_error
from core.journal.verify import Verdict
from core.journal.writer import Writer
from core.ledger.commands import Command, accounts_of, fingerprint_of, transaction_of
from core.rulings import Rulings
from core.settings import Settings
from core.slots import Draining, NoSlot, Slots
from core.tenure import Tenure

T = TypeVar("T")

DRILL: Final = "drill"  # the kind of a drill's command


class _Claim(msgspec.Struct):
    """What every answer of a booking says of its place in the book; 0: it booked nothing."""

    seq: int = 0


class ReadTooLong:
    """The question takes longer than a read may."""


class Unwritten(msgspec.Struct, frozen=True):
    """In the writer's place of a core that was started to read only: `head_seq` is the last event there is."""

    head_seq: int


class Service(Slots):
    """What the web asks of the core. All methods on the loop's thread."""

    def __init__(
        self,
        writer: Writer | Unwritten,
        readers: Engine,
        recorder: FlightRecorder,
        settings: Settings,
        epoch: int,
        safe: str | None = None,
        on_fenced: Callable[[int], object] | None = None,
        rulings: Rulings | None = None,
    ) -> None:
        """Take the started parts. `readers` is not opened before the first read.

        `safe`: the diagnosis because of which only reads are served; without a writer there always is one.
        `on_fenced` is told the higher epoch when this core, after it was stopped for a while, finds that another has
        taken over; it must end the process. Without it nobody looks. `rulings`: absent, there are none.
        """
        assert safe is not None or isinstance(writer, Writer), "a core without a writer can only read"
        super().__init__(recorder, settings, rulings or Rulings())
        self._admission = Admission(self.rulings.quarantine)
        self.epoch = epoch
        self.safe = safe
        self.gone_by = ""  # the checkpoint that the start went by
        self.hub = Hub()
        self._writer = writer
        self.readers = readers
        self._threads = ThreadPoolExecutor(settings.readers, thread_name_prefix="reader")
        self.auditor = Auditor(readers, recorder, settings, self.rulings.rebuilding, self.leaving)
        self.exporter = Exporter(readers, recorder, settings, self.rulings)
        self._tenure = Tenure(epoch, self._stored_epoch, on_fenced) if on_fenced is not None else None
        self._in_line: dict[str, asyncio.Future[Answer]] = {}  # by key: the newest command under it

    @property
    def head_seq(self) -> int:
        """The last event this core knows of, without asking the store."""
        return self._writer.head_seq

    def beat(self, now_ns: int) -> None:
        """Notice at a beat of the loop that this process was stopped for a while."""
        if self._tenure is not None:
            self._tenure.beat(now_ns)

    async def still_ours(self) -> None:
        """Return once this core may answer: at once, or, where it may have been stopped, after a look at the store."""
        if self._tenure is not None:
            await self._tenure.sure()

    def lay_down(self) -> None:
        """Take nothing new for good, prove nothing more, and ask no more whose book it is: it is a successor's."""
        self._laid_down = True
        self.drain()
        if self._tenure is not None:
            self._tenure.lay_down()

    async def _stored_epoch(self) -> int | None:
        def look() -> int | None:
            try:
                with snapshot(self.readers, self.settings.read_ms_max) as connection:
                    epoch: int = queries.head(connection).epoch
                    return epoch
            except DBAPIError:
                return None

        if self.leaving.is_set():
            return None  # its threads are about to end, and so is it
        return await asyncio.get_running_loop().run_in_executor(self._threads, look)

    async def carry_out(
        self,
        command: Command,
        key: str | None,
        digest: bytes,
        command_id: str,
        slot: int,
        *,
        kind: str = "",
        name: str = "",
        body_bytes: int = 0,
    ) -> Answer:
        """Put the command in the writer's line and return its answer, which is durable if it says so.

        A core that serves reads only does not do it, and still knows what was done before under its key; nor does one
        that the guard's rules forbid it. `kind`, `name` (if that is not its key's) and `body_bytes` are what they go by.
        """
        # Plain strings in this frame, for whoever reads a dump of a stuck request.
        transaction_id = transaction_of(command)
        account_ids = accounts_of(command)
        account_id = ids_shown(account_ids)  # noqa: F841  for whoever asks for tasks
        _name_task(transaction_id or command_id)
        fingerprint = fingerprint_of(command)
        if self.safe is not None:
            return await self._recall(self.safe, key, fingerprint, slot)
        if self.rulings.want_names:
            name = name or (name_of(key) if key is not None else "")
            refused = await self._refused(Wish(kind, name, digest, fingerprint, body_bytes), key, slot)
            if refused is not None:
                return refused
        order = Order(command, key, fingerprint, digest, command_id, transaction_id, account_ids, slot, name)
        answer = await self._stand_in_line(order)
        self._tell_claim(answer)
        return answer

    async def carry_out_each(
        self, orders: Sequence[Order], slot: int, wish: Wish | None = None
    ) -> Sequence[Answer] | None:
        """Put commands in the writer's line as one piece of work and return the answer of each, as `carry_out` does.

        All of them have one slot and are in the book together or not at all. `wish`: the one request that they came
        with, which the rules go by. Without it none is held against the rules: nothing is done, and None returned, where
        it matters what a command is called; and where this core serves reads only.
        """
        if wish is None and (self.safe is not None or self.rulings.want_names):
            return None
        if self.safe is not None:
            return await self._recall_each(self.safe, orders, slot)
        if wish is not None and orders and self.rulings.want_names:
            refused = await self._refused(wish, orders[0].key, slot)
            if refused is not None:
                return [refused] * len(orders)
        assert isinstance(self._writer, Writer), "a core without a writer refuses before"
        future = self._writer.submit(Orders(tuple(orders), slot, name=wish.name if wish is not None else ""))
        keys = [order.key for order in orders if order.key is not None]
        self._in_line.update(dict.fromkeys(keys, future))
        future.add_done_callback(partial(self._leave_line, keys))
        answer = await asyncio.shield(future)
        if not isinstance(answer, Each):
            return [answer] * len(orders)
        booked = [
            one.commit.seq for one in answer.answers if isinstance(one, Done) and one.commit is not None
        ]
        if booked:
            self._recorder.answered(max(booked))
        return answer.answers

    async def exercise(
        self, key: str, digest: bytes, command_id: str, account_id: str, slot: int
    ) -> Answer | None:
        """Carry out the command of a drill, which books nothing; None: no drill of this key is armed."""
        name = name_of(key)
        refused = await self._refused(Wish(DRILL, name, digest, key.encode(), 0), None, slot)
        if refused is not None:
            return refused
        armed = self.rulings.armoury.armed
        if armed is None or name not in armed.names:
            return None
        if self.safe is not None:
            return ReadOnly(self.safe)
        assert isinstance(self._writer, Writer), "a core without a writer refuses before"
        return await self._writer.submit(Exercise(slot, command_id, account_id, None, name=name))

    async def _refused(self, wish: Wish, key: str | None, slot: int) -> Answer | None:
        """Return why the rules forbid this wish; None: they don't, or it is done, and only told again."""
        refused = self._admission.refusal(wish, time.monotonic_ns())
        if refused is None or key is None:
            return refused
        kept = await self.look_up(key, None, slot)
        if isinstance(kept, KeyUnknown):
            return refused
        # Known: it goes into the line and is told again. Whatever else: nobody can say now whether it is done.
        return None if isinstance(kept, Done | Refused | KeyTaken) else kept

    async def _stand_in_line(self, order: Order) -> Answer:
        assert isinstance(self._writer, Writer), "a core without a writer refuses before"
        future = self._writer.submit(order)
        if order.key is None:
            return await future
        self._in_line[order.key] = future
        future.add_done_callback(partial(self._leave_line, (order.key,)))
        # Who leaves does not take his command out of the line: it stands in the list until it is answered.
        return await asyncio.shield(future)

    def _leave_line(self, keys: Sequence[str], future: "asyncio.Future[Answer]") -> None:
        for key in keys:
            if self._in_line.get(key) is future:
                del self._in_line[key]

    async def _recall(self, safe: str, key: str | None, fingerprint: bytes, slot: int) -> Answer:
        """Return what was done before under this key, or that nothing is done now."""
        if key is None:
            return ReadOnly(safe)
        kept = await self._kept(key, slot)
        if isinstance(kept, OutcomeUnknown):
            return kept
        return ReadOnly(safe) if kept is None else repeated(kept, fingerprint)

    async def _recall_each(self, safe: str, orders: Sequence[Order], slot: int) -> Sequence[Answer]:
        """Return what was done before under the keys of these, or that nothing is done now."""
        if not orders or orders[0].key is None:
            return [ReadOnly(safe)] * len(orders)
        if not await self._is_out_of_line(orders[0].key):
            return [OutcomeUnknown()] * len(orders)
        found_now = await self.read(
            slot, lambda connection: (epoch_of(connection), fetch_keys(connection, orders))
        )
        if isinstance(found_now, ReadTooLong | StoreError):
            return [OutcomeUnknown()] * len(orders)
        epoch, rows = found_now
        if epoch != self.epoch or (rows and isinstance(self._writer, Unwritten)):
            return [OutcomeUnknown()] * len(orders)
        return [
            repeated(rows[order.key], order.fingerprint) if order.key in rows else ReadOnly(safe)
            for order in orders
        ]

    async def _kept(self, key: str, slot: int) -> KeyRow | OutcomeUnknown | None:
        """Return the row of a key, read from the store once nothing under it stands in the writer's line.

        Unknown: what stands in the line is not over in the time that a batch may wait for the store, the row can't
        be read, another core has taken over, or it is there and this core has raised no epoch: then nobody has
        seen to it that what the dead one wrote last lasts.
        """
        if not await self._is_out_of_line(key):
            return OutcomeUnknown()
        found_now = await self.read(slot, partial(read_key, key=key))
        if isinstance(found_now, ReadTooLong | StoreError):
            return OutcomeUnknown()
        epoch, row = found_now
        if epoch != self.epoch or (row is not None and isinstance(self._writer, Unwritten)):
            return OutcomeUnknown()
        return row

    async def _is_out_of_line(self, key: str) -> bool:
        """Wait until nothing under this key stands in the line, and return whether that came about.

        Not for ever: the very writer that made this core read only may never come back, and whoever waits here
        has a slot that a read could have.
        """
        try:
            async with asyncio.timeout(self.settings.write_busy_ms / 1000):
                while (ahead := self._in_line.get(key)) is not None:
                    await asyncio.wait([ahead])
        except TimeoutError:
            return False
        return True

    def _tell_claim(self, answer: Answer) -> None:
        """Tell the recorder what the answer claims to be committed, in its own words and not in the writer's.

        A replayed answer claims what an earlier life may have committed, of which this page knows nothing.
        """
        if isinstance(answer, Done) and not answer.replayed:
            self._recorder.answered(msgspec.json.decode(answer.body, type=_Claim).seq)

    async def look_up(self, key: str, digest: bytes | None, slot: int) -> Answer:
        """Return what became of a key (of one request under it), true at a moment after this call."""
        if self.safe is not None:
            kept = await self._kept(key, slot)
            return kept if isinstance(kept, OutcomeUnknown) else found(kept, digest)
        assert isinstance(self._writer, Writer), "a core without a writer is safe from its first moment"
        return await self._writer.submit(LookUp(key, slot, digest))

    async def read(
        self,
        slot: int,
        question: Callable[[Connection], T],
        *,
        transaction_id: str = "",
        account_id: str = "",
    ) -> T | ReadTooLong | StoreError:
        """Ask the book on a reader's thread, at one moment and in bounded time.

        `transaction_id` and `account_id` name in a stack dump what is asked about.
        """
        ask = partial(self._ask, slot, question, transaction_id, account_id)
        return await asyncio.get_running_loop().run_in_executor(self._threads, ask)

    def _ask(
        self,
        slot: int,
        question: Callable[[Connection], T],
        transaction_id: str,  # noqa: ARG002  for stack dumps
        account_id: str,  # noqa: ARG002  for stack dumps
    ) -> T | ReadTooLong | StoreError:
        self._recorder.stage(slot, Stage.DECIDING)
        try:
            with snapshot(self.readers, self.settings.read_ms_max) as connection:
                return question(connection)
        except DBAPIError as error:
            return ReadTooLong() if is_interrupted(error) else store_error(error)

    async def verify(self) -> Verdict | StoreError | NoSlot | Draining:
        """Prove the whole book as it stands after this call."""
        return Draining() if self._draining else await self.auditor.verify()

    def drain(self) -> None:
        """Take nothing new from now on, and give up what is only proven behind."""
        self._draining = True
        self.leaving.set()

    async def end_threads(self) -> None:
        """End the threads that read, each after what it is asking."""
        # On a thread, because a read may take its time and a loop that waits for it would look blocked.
        await asyncio.to_thread(self._threads.shutdown)
        await self.auditor.end()
        await self.exporter.end()

    async def close(self) -> None:
        """Write what waits and close the store. Only after `drain`."""
        await self.end_threads()
        # The writer's connection is the last to close: it empties the log, so that a ledger at rest is one file.
        self.readers.dispose()
        if isinstance(self._writer, Writer):
            await self._writer.stop()


def _name_task(command: str) -> None:
    """Give the task of a request the name of its command: a list of tasks is then read without their frames."""
    task = asyncio.current_task()
    if task is not None:
        task.set_name(f"cmd:{command}")
