"""The writer: one thread that takes what waits, writes it as one batch, and takes again.

Batches are as large as the load makes them: while one is being flushed the next one gathers. A timer to wait
for company was measured and loses, also under load. Answers go back to the event loop in one hop per batch,
only after the transaction is over. The queue needs no bound of its own: whoever stands in it holds a slot of
the recorder, and there are only so many.
"""

import asyncio
import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, assert_never

from core.guarded.recorder import FlightRecorder
from core.journal.answers import Answer, Leaving, Work
from core.journal.append import Committed, Failed, FencedBy, Journal, NotBegun, NotTaken
from core.journal.store import StoreError
from core.ledger.events import Event

BATCH_MAX: Final = 256  # as many as there are slots

Waiting = tuple[Work, "asyncio.Future[Answer]"]
Listener = Callable[[Sequence[tuple[int, Event]]], None]


class Writer:
    """The thread that owns the journal. `submit` and `stop` are called on the event loop's thread."""

    def __init__(
        self,
        journal: Journal,
        recorder: FlightRecorder,
        loop: asyncio.AbstractEventLoop,
        on_shut: Callable[[StoreError], None],
        on_failed: Callable[[str], None],
        on_fenced: Callable[[int], None],
        on_bug: Callable[[Exception], None],
    ) -> None:
        """Prepare the thread.

        `on_shut` is called on the loop when the store took no write, before the batch hears so. `on_failed` is
        called on the loop, after the answers of the batch that failed were given, with what
        the store said. `on_fenced` is called on the writer's thread with the higher epoch and must end the
        process: nobody may be answered any more. `on_bug` is called there too and must end the process: a
        core without its writer would take commands and never answer one.
        """
        self._journal = journal
        self._recorder = recorder
        self._loop = loop
        self._on_shut = on_shut
        self._on_failed = on_failed
        self._on_fenced = on_fenced
        self._on_bug = on_bug
        self._listener: Listener | None = None
        self._waiting: deque[Waiting] = deque()
        self._changed = threading.Condition()
        self._stopping = False
        self._over = False
        self._thread = threading.Thread(target=self._run, name="writer")

    @property
    def head_seq(self) -> int:
        """The last event that is committed, as far as this process knows."""
        return self._journal.head_seq

    def listen(self, listener: Listener | None) -> None:
        """Have `listener` called on the loop with the numbered events of each batch, in order; None: nobody listens.

        It is called after COMMIT and after the batch was answered. It must not raise and must not wait.
        """
        self._listener = listener

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def submit(self, work: Work) -> "asyncio.Future[Answer]":
        """Put work in the line and return the future of its answer."""
        future: asyncio.Future[Answer] = self._loop.create_future()
        if self._stopping:
            future.set_result(Leaving())
            return future
        with self._changed:
            self._waiting.append((work, future))
            self._changed.notify()
        return future

    def pretend_full(self, until_ns: int) -> None:
        """Have the journal answer as a full disk would until `until_ns`, monotonic: a drill."""
        self._journal.pretend_full(until_ns)

    async def stop(self) -> None:
        """Write what waits, close the store and end the thread."""
        self.ask_to_stop()
        await self._loop.run_in_executor(None, self._thread.join)

    def ask_to_stop(self) -> None:
        """Have the thread write what waits, close the store and end; see `is_alive` for when it has."""
        with self._changed:
            self._stopping = True
            self._changed.notify()

    def go_on(self) -> bool:
        """Take work again after `ask_to_stop`; False where it is too late: the store is closed, or about to be."""
        with self._changed:
            self._stopping = self._over
        return not self._over

    @property
    def is_alive(self) -> bool:
        """Whether the thread has not ended yet."""
        return self._thread.is_alive()

    def _run(self) -> None:
        self._recorder.note_writer_thread()
        try:
            self._write_batches()
        # Everything the store can raise is a value by now: what arrives here is our own bug.
        except Exception as error:  # noqa: BLE001
            self._on_bug(error)

    def _write_batches(self) -> None:
        while batch := self._take():
            works = [work for work, _ in batch]
            outcome = self._journal.write(works)
            match outcome:
                case Committed(answers, events):
                    self._loop.call_soon_threadsafe(self._publish, batch, answers, events)
                case NotBegun(answers):
                    self._loop.call_soon_threadsafe(_give, batch, answers)
                case NotTaken(answers, error):
                    self._recorder.event("STORE_SHUT", error.text)
                    self._loop.call_soon_threadsafe(self._shut, batch, answers, error)
                case Failed(answers, error):
                    self._recorder.last_words("COMMIT_FAILED", error.text)
                    self._loop.call_soon_threadsafe(self._fail, batch, answers, error.text)
                    return
                case FencedBy(actual):
                    self._on_fenced(actual)
                    return
                case _:
                    assert_never(outcome)
        self._journal.close()

    def _take(self) -> list[Waiting]:
        """Wait for work and take what is there; empty once stopping and nothing waits."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._stopping)
            self._over = not self._waiting
            return [self._waiting.popleft() for _ in range(min(len(self._waiting), BATCH_MAX))]

    def _publish(
        self, batch: Sequence[Waiting], answers: Sequence[Answer], events: Sequence[tuple[int, Event]]
    ) -> None:
        _give(batch, answers)
        if self._listener is not None and events:
            self._listener(events)

    def _shut(self, batch: Sequence[Waiting], answers: Sequence[Answer], error: StoreError) -> None:
        self._on_shut(error)
        _give(batch, answers)

    def _fail(self, batch: Sequence[Waiting], answers: Sequence[Answer], text: str) -> None:
        self._stopping = True
        _give(batch, answers)
        with self._changed:
            never_begun = list(self._waiting)
            self._waiting.clear()
        _give(never_begun, [Leaving()] * len(never_begun))
        self._on_failed(text)


def _give(batch: Sequence[Waiting], answers: Sequence[Answer]) -> None:
    for (_, future), answer in zip(batch, answers, strict=True):
        if not future.done():  # the request that asked may have been cancelled
            future.set_result(answer)
