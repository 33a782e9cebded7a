"""The notifier: the component that tells open pages what was committed, beside the writer and not in its way.

What the writer has committed waits here in a bounded line until it is put into frames and given to the hub. Where the
notifier stood still and the line has grown too long, all of it becomes one frame that says: read anew. What was being
told when it was begun anew is told again; a page knows each event by its number. Not chosen: to tell within the
writer's own turn; then a mistake in a frame would be a mistake of the writer.
"""

import asyncio
import logging
from collections import deque
from collections.abc import Sequence
from typing import Final

from core import frames
from core.guarded.recorder import FlightRecorder
from core.hub import WAITING_FRAMES_MAX, Hub
from core.ledger.events import Event

NOTIFIER: Final = "notifier"  # its name on the recorder page
SILENT_MS_MAX: Final = 5_000  # it waits for nothing but the loop

Committed = Sequence[tuple[int, Event]]

logger = logging.getLogger("core")


class Notifier:
    """The component. All methods on the loop's thread."""

    def __init__(self, hub: Hub, recorder: FlightRecorder) -> None:
        """Prepare; nothing is told before `start`."""
        self._hub = hub
        self._beats = recorder.component(NOTIFIER, SILENT_MS_MAX)
        self._waiting: deque[Committed] = deque()
        self._events = 0  # in the line
        self._missed_seq: int | None = None  # the newest event that the line had no room for
        self._changed = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._stalls = False

    def start(self) -> None:
        """Tell from now on."""
        self._task = asyncio.create_task(self._run(), name=NOTIFIER)

    def stop(self) -> None:
        """Tell no more."""
        if self._task is not None:
            self._task.cancel()

    def committed(self, events: Committed) -> None:
        """Have events told, each with its number; costs nothing while nobody listens."""
        if not self._hub.listeners and not self._waiting:
            return
        self._waiting.append(events)
        self._events += len(events)
        if self._events > WAITING_FRAMES_MAX:
            self._missed_seq = events[-1][0]
            self._forget()
        self._changed.set()

    def begin_anew(self) -> None:
        """Tell what waits, in a new task; the one before was never in the middle of anything but a wait."""
        self._stalls = False
        self.stop()
        self._changed.set()
        self.start()

    def stall(self) -> None:
        """Wait for what never comes, with something to tell: a drill."""
        self._stalls = True
        self._changed.set()

    async def _run(self) -> None:
        while True:
            await self._changed.wait()
            self._changed.clear()
            self._beats.works(True)
            if self._stalls:
                await asyncio.Event().wait()
            while self._waiting or self._missed_seq is not None:
                self._tell()
                await asyncio.sleep(0)  # a long line is no reason to keep anybody waiting
            self._beats.works(False)

    def _tell(self) -> None:
        missed, self._missed_seq = self._missed_seq, None
        if missed is not None:
            self._hub.tell([frames.resync(missed)])
        if self._waiting:
            try:
                frames.tell_committed(self._hub, self._waiting[0])
            # A mistake in one frame must not end the telling of all others; the page reads anew instead.
            except Exception:
                logger.exception("What was committed could not be told")
                self._hub.tell([frames.resync(self._waiting[0][-1][0])])
            self._events -= len(self._waiting.popleft())
        self._beats.done()

    def _forget(self) -> None:
        self._waiting.clear()
        self._events = 0
