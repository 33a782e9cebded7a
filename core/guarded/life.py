"""One guarded life: everything that a guard can see or say, put together around the core's work.

Two steps, because they have two moments. `take_instruments` comes first of all, before any thread and any
store: from then on a death leaves evidence. `guarded_life` surrounds the event loop's work: while it is
open the loop beats, the control socket answers and a TERM is heard. A core without a guard goes through
the same two steps; what it was not given is simply not opened, so there is no second way to test.
"""

import asyncio
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

import msgspec

from core.guarded import agent, oom
from core.guarded.beacon import Beacon
from core.guarded.beats import BEAT_MS, LoopBeat, ThreadBeat, note_collections
from core.guarded.census import CENSUS_MS, CensusTaker
from core.guarded.control import ControlServer, Guarded
from core.guarded.environment import GuardedEnvironment
from core.guarded.last_words import keep_last_words, keep_loop_errors
from core.guarded.recorder import FlightRecorder, NoRecorder, Recorder, RecorderUnusable
from core.guarded.term import TermWatch, hold_term
from core.guarded.tracing import allow_tracing

#: How often the beacon sends again what was not taken, when no watchdog asks for more.
RESEND_S = 1.0


class Instruments(msgspec.Struct, frozen=True):
    """What the core tells its guard with."""

    recorder: FlightRecorder
    beacon: Beacon


def take_instruments(environment: GuardedEnvironment) -> Instruments | RecorderUnusable:
    """Open recorder and beacon and keep last words; call it first, on the main thread, before any other.

    From here on TERM is held back until `guarded_life` hears it.
    """
    hold_term()
    recorder: Recorder | RecorderUnusable = NoRecorder()
    if environment.recorder is not None:
        recorder = Recorder.open(environment.recorder)
    if isinstance(recorder, RecorderUnusable):
        return recorder
    keep_last_words(recorder, stacks_path(environment.recorder))
    if environment.guarded:
        allow_tracing()
        oom.rank(oom.SPARE if environment.spare else oom.CORE)
    return Instruments(recorder, Beacon(environment.notify_socket))


def stacks_path(recorder: Path | None) -> Path | None:
    """Return the file beside a recorder page that faulthandler writes to."""
    return None if recorder is None else recorder.with_name(recorder.name + ".stacks")


@asynccontextmanager
async def guarded_life(
    environment: GuardedEnvironment,
    recorder: FlightRecorder,
    beacon: Beacon,
    *,
    guarded: Guarded,
    on_term: Callable[[int], None],
    on_beat: Callable[[int], None] | None = None,
    beat_ms: int = BEAT_MS,
    census_ms: int = CENSUS_MS,
) -> AsyncIterator[None]:
    """Be seen and be reachable until the block ends.

    `guarded` takes the orders of the control socket. `on_term` is called once, on the loop, with the pid of the
    first TERM's sender (0: unknown); that it came is already noted and told by then. `on_beat` is told the monotonic
    time of each beat of the loop. Raises ControlUnboundError (an OSError) when the control socket can't be bound.
    """
    loop = asyncio.get_running_loop()
    async with AsyncExitStack() as ending:
        keep_loop_errors(loop, recorder)
        ending.callback(note_collections(recorder))
        loop_beat = LoopBeat(loop, recorder, beat_ms, on_beat)
        loop_beat.start()
        ending.callback(loop_beat.stop)
        thread_beat = ThreadBeat(recorder, beat_ms)
        thread_beat.start()
        agent.begin_if_told(environment.agents, environment.listen_fd)
        ending.callback(thread_beat.stop)
        census = CensusTaker(recorder, census_ms, environment.memory_bytes)
        census.start()
        ending.callback(census.stop)
        _Watchdog(loop, beacon, environment.watchdog_usec, ending).start()
        if environment.control is not None:
            control = ControlServer(environment.control, guarded, recorder.event)
            await control.open()
            ending.push_async_callback(control.close)
        _hear_term(loop, recorder, beacon, on_term, ending)
        yield


class _Watchdog:
    """Tells the service manager that the loop runs, and gives it what it has not taken before."""

    def __init__(
        self, loop: asyncio.AbstractEventLoop, beacon: Beacon, usec: int | None, ending: AsyncExitStack
    ) -> None:
        self._loop = loop
        self._tell: Callable[[], object] = beacon.resend if usec is None else beacon.watchdog
        # A third: half of the time is what managers ask for, and a timer may be late.
        self._every_s = RESEND_S if usec is None else min(RESEND_S, usec / 3_000_000)
        self._next: asyncio.TimerHandle | None = None
        ending.callback(self._stop)

    def start(self) -> None:
        self._tell()
        self._next = self._loop.call_later(self._every_s, self.start)

    def _stop(self) -> None:
        if self._next is not None:
            self._next.cancel()


def _hear_term(
    loop: asyncio.AbstractEventLoop,
    recorder: FlightRecorder,
    beacon: Beacon,
    on_term: Callable[[int], None],
    ending: AsyncExitStack,
) -> None:
    told = False

    def once(sender: int) -> None:
        nonlocal told
        if not told:
            told = True
            on_term(sender)

    def heard(sender: int) -> None:
        # Told from this thread, so that it is told even when the loop no longer runs anything.
        recorder.event("TERM", f"from process {sender}")
        beacon.term_from(sender)
        loop.call_soon_threadsafe(once, sender)

    watch = TermWatch(heard)
    watch.start()
    ending.callback(watch.stop)
    # For a thread that was started before TERM was held back: heard, though nobody knows from whom.
    loop.add_signal_handler(signal.SIGTERM, heard, 0)
    ending.callback(loop.remove_signal_handler, signal.SIGTERM)
