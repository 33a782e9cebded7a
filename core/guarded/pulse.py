"""The beat block of a recorder page: signs of life, each one word, stored in one go.

Nothing here is under a lock, because each word means something alone and is stored by one thread: a
garbage collection may interrupt any line of any thread and still say so, and a reader never waits. Two
beats, one by the event loop and one by a thread, because the *pair* tells a blocked loop from a held
interpreter. Not chosen: one beat with a cause in it; a stuck process can't write its cause.
"""

import os
import threading
from collections.abc import Callable
from enum import IntEnum
from pathlib import Path

from core.guarded import page


class LifeState(IntEnum):
    """What the core says of itself."""

    STARTING = 0
    READY = 1
    DRAINING = 2
    STOPPING = 3
    SPARE = 4  # it waits to be promoted


def _start_ticks() -> int:
    """Return field 22 of /proc/self/stat: with the pid, the identity of this process until reboot."""
    # The command name (field 2) may hold spaces and brackets, so the count starts behind its last one.
    return int(Path("/proc/self/stat").read_bytes().rpartition(b")")[2].split()[19])


class Pulse:
    """Who this process is, and that it lives."""

    def __init__(self, words: memoryview, clock: Callable[[], int]) -> None:
        """Make the page this process's own; call it on the thread of the event loop."""
        self._words = words
        self._clock = clock
        self._loop_beats = 0
        self._thread_beats = 0
        self._answered = 0
        self._own()

    def _own(self) -> None:
        words = self._words
        words[page.PID_AT // 8] = os.getpid()
        words[page.START_AT // 8] = _start_ticks()
        words[page.LOOP_THREAD_AT // 8] = threading.get_native_id()
        # Last: a reader that sees the flag may trust pid and start.
        words[page.OWNED_AT // 8] = 1

    def set_epoch(self, n: int) -> None:
        """Say which epoch this core has raised."""
        self._words[page.EPOCH_AT >> 3] = n

    @property
    def epoch(self) -> int:
        """The epoch this core has raised, 0 before that."""
        return self._words[page.EPOCH_AT >> 3]

    def log_counts(self, warnings: int, errors: int) -> None:
        """Say how many warnings and errors this life has written to its log so far. Under the log's own lock."""
        self._words[page.LOG_WARNINGS_AT >> 3] = warnings
        self._words[page.LOG_ERRORS_AT >> 3] = errors

    def loop_lag(self, lag_ns: int) -> None:
        """Say how late the event loop came to its beats lately. Loop thread only."""
        self._words[page.LOOP_LAG_AT >> 3] = lag_ns

    def set_state(self, state: LifeState) -> None:
        """Say where in its life this core is."""
        self._words[page.STATE_AT >> 3] = state

    def note_writer_thread(self) -> None:
        """Say that the calling thread is the one that writes to the store."""
        self._words[page.WRITER_THREAD_AT >> 3] = threading.get_native_id()

    def beat_loop(self, now_ns: int) -> None:
        """Say that the event loop runs. Loop thread only."""
        self._loop_beats += 1
        self._words[page.LOOP_NS_AT >> 3] = now_ns
        self._words[page.LOOP_COUNT_AT >> 3] = self._loop_beats

    def beat_thread(self, now_ns: int) -> None:
        """Say that this process gets to run threads. Beat thread only: the first call notes its id."""
        if not self._thread_beats:
            self._words[page.BEAT_THREAD_AT >> 3] = threading.get_native_id()
        self._thread_beats += 1
        self._words[page.THREAD_NS_AT >> 3] = now_ns
        self._words[page.THREAD_COUNT_AT >> 3] = self._thread_beats

    def answered(self, seq: int) -> None:
        """Say that an answer claims `seq` to be committed by this life; only the highest counts. Loop thread only."""
        if seq > self._answered:
            self._answered = seq
            self._words[page.ANSWERED_AT >> 3] = seq

    def in_store(self, on: bool) -> None:  # noqa: FBT001  there is nothing else to say
        """Say that a transaction is open (from BEGIN to COMMIT) or no longer. Writer thread only."""
        self._words[page.IN_STORE_AT >> 3] = self._clock() if on else 0

    def gc(self, on: bool) -> None:  # noqa: FBT001  there is nothing else to say
        """Say that a collection begins or ends. Called in the middle of anything, so it takes no lock."""
        self._words[page.IN_GC_AT >> 3] = self._clock() if on else 0
