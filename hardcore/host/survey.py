"""What is looked at once a second, on a thread of its own: the disk, memory, the core's conduct, the kernel's kills.

The loop that decides must not ask a disk anything, and neither may the hands be kept from starting a core; so this
thread belongs to the survey alone, and what may hang is an errand even of this one. It looks at the life that it
was last told of and says what it saw; a look that fails is left out and the next one tried.
"""

import os
import threading
from collections.abc import Callable
from pathlib import Path

import msgspec

from hardcore.host import clock, memory, vitals
from hardcore.host.conduct import ConductWatch
from hardcore.host.disk import DiskWatch
from hardcore.host.lives import Life
from hardcore.model.looks import Conduct
from hardcore.model.observations import Surveyed

#: A write of ours that is not back yet is looked at again so soon: how long it took is known only from looking.
PENDING_S = 0.5


class _Watched(msgspec.Struct):
    """The life that is being looked at."""

    life: Life
    conduct: ConductWatch


class Survey:
    """Surveys every `interval_s`, and at once when asked; `tell` is called on the survey's thread."""

    def __init__(
        self,
        data: Path,
        state: Path,
        interval_s: float,
        tell: Callable[[Surveyed], None],
        trouble: Callable[[str], None],
    ) -> None:
        self._disk = DiskWatch(data, state)
        self.interval_s = interval_s
        self._tell = tell
        self._trouble = trouble
        self._wake = threading.Event()
        self._asked = self._closed = self._pending = False
        self._life: Life | None = None
        self._watched: _Watched | None = None
        self._last_trouble = ""
        self._thread = threading.Thread(target=self._survey_on, name="survey", daemon=True)

    def begin(self) -> None:
        """Start the thread."""
        self._thread.start()

    def watch(self, life: Life | None) -> None:
        """Look at this life from now on."""
        self._life = life

    def ask(self) -> None:
        """Look now, and write to the disk, however well it was a moment ago."""
        self._asked = True
        self._wake.set()

    def close(self, limit_s: float) -> bool:
        """End the thread; wait for that no longer than `limit_s`, and return whether it has ended."""
        self._closed = True
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join(limit_s)
        return not self._thread.is_alive()

    def _survey_on(self) -> None:
        while not self._closed:
            now, self._asked = self._asked, False
            self._wake.clear()
            try:
                surveyed = self._look(now=now)
            except Exception as error:  # noqa: BLE001  # a watch without its survey is worth more than none
                self._say(f"{type(error).__name__}: {error}")
            else:
                self._say("")
                if surveyed is not None and not self._closed:
                    self._tell(surveyed)
            self._wake.wait(min(self.interval_s, PENDING_S) if self._pending else self.interval_s)

    def _say(self, trouble: str) -> None:
        """Tell of a trouble once, not once a second."""
        if trouble and trouble != self._last_trouble:
            self._trouble(trouble)
        self._last_trouble = trouble

    def _look(self, *, now: bool) -> Surveyed | None:
        life = self._life
        if life is None or life.handle is None:
            return None
        if self._watched is None or self._watched.life is not life:
            self._watched = _Watched(life, ConductWatch(life.handle.pid))
        # What is told of a number is told of this life only if it was still there afterwards.
        private, limit = memory.private_bytes(life.handle.pid), vitals.fds_limit(life.handle.pid)
        lives = life.handle.signal(0)
        # A core that is gone has no conduct, but its disk is what its successor will need.
        conduct = _conduct(self._watched) if lives else None
        log = life.reader.log_counts() if lives and life.reader is not None else None
        free = memory.free_bytes(os.getpid())
        disk = self._disk.look(clock.now_ns(), now=now)
        self._pending = disk is not None and disk.pending_ns > 0
        return Surveyed(
            clock.now_ns(),
            life.number,
            disk,
            conduct,
            life.oom_kills(),
            free,
            log=log,
            private_bytes=private if lives else None,
            fds_limit=limit if lives else None,
        )


def _conduct(watched: _Watched) -> Conduct:
    life = watched.life
    threads = life.sample.threads if life.sample is not None else None
    return watched.conduct.look(clock.now_ns(), threads, life.fds)
