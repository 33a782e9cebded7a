"""Signs of life: a beat from the event loop, one from a thread, and a note while memory is collected.

A beat is worth what it depends on. The loop's is an ordinary `call_later`, so it stops when the guarded
work itself stops; the thread's needs only the interpreter lock, so the pair tells "the loop is blocked"
from "nobody may run". A full collection of a large heap stops both for seconds in a healthy process,
which is why it is announced. Not chosen: a timer signal; it interrupts the very call it should judge.
"""

import asyncio
import gc
import threading
import time
from collections.abc import Callable

from core.guarded.recorder import FlightRecorder

#: How often both beats are due, in milliseconds: four to a tick of the guard.
BEAT_MS = 25
#: How much of a lag is left at the next beat: after half a second on time, a third of it. Whoever looks ten times a
#: second so sees the one beat that was late.
_LAG_LEFT_PERCENT = 95


class LoopBeat:
    """The event loop's own beat. Start and stop it on the loop's thread."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        recorder: FlightRecorder,
        beat_ms: int,
        on_beat: Callable[[int], None] | None = None,
    ) -> None:
        """Beat first at `start`, then every `beat_ms`. `on_beat` is told the monotonic time of each."""
        self._loop = loop
        self._on_beat = on_beat
        self._recorder = recorder
        self._every_s = beat_ms / 1000
        self._next: asyncio.TimerHandle | None = None
        self._every_ns = beat_ms * 1_000_000
        self._due_ns: int | None = None
        self._lag_ns = 0

    def start(self) -> None:
        """Beat now and from now on."""
        now_ns = time.monotonic_ns()
        self._recorder.beat_loop(now_ns)
        if self._due_ns is not None:
            self._lag_ns = max(now_ns - self._due_ns, self._lag_ns * _LAG_LEFT_PERCENT // 100)
            self._recorder.loop_lag(self._lag_ns)
        self._due_ns = now_ns + self._every_ns
        if self._on_beat is not None:
            self._on_beat(now_ns)
        self._next = self._loop.call_later(self._every_s, self.start)

    def stop(self) -> None:
        """Beat no more."""
        if self._next is not None:
            self._next.cancel()
            self._next = None


class ThreadBeat:
    """The beat of a thread that does nothing else."""

    def __init__(self, recorder: FlightRecorder, beat_ms: int) -> None:
        """Beat first at `start`, then every `beat_ms`."""
        self._recorder = recorder
        self._every_s = beat_ms / 1000
        self._ending = threading.Event()
        # A daemon: a process that leaves by an exception shall not wait for its own pulse.
        self._thread = threading.Thread(target=self._run, name="beat", daemon=True)

    def start(self) -> None:
        """Beat from now on."""
        self._thread.start()

    def stop(self) -> None:
        """Beat no more; returns when the thread has ended."""
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        self._recorder.beat_thread(time.monotonic_ns())
        while not self._ending.wait(self._every_s):
            self._recorder.beat_thread(time.monotonic_ns())


def note_collections(recorder: FlightRecorder) -> Callable[[], None]:
    """Say in the recorder while a collection above the youngest generation runs; return how to stop it."""

    def note(phase: str, info: dict[str, int]) -> None:
        # The youngest generation is collected again and again and is over in a moment.
        if info["generation"]:
            recorder.gc(phase == "start")

    gc.callbacks.append(note)
    return lambda: gc.callbacks.remove(note)
