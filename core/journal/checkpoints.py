"""The folder of checkpoints: written whole or not at all, kept by number and age, and the newest good one found.

`DATA/checkpoints` belongs to the core that writes the book. What is being written has a name of its own and takes its
place once it is on the disk, so a death leaves a file that nobody reads and the next core sweeps. Which one is newest
is a matter of the book's numbers; which ones go is a matter of when they were written, because an older copy of the
ledger that was put back must not find its new checkpoints thrown away for those of a state that is no more. The one
written last is always kept, however old: a book that nobody writes to has no newer one.
"""

import os
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec
from sqlalchemy import Connection

from core.journal import checkpoint, queries
from core.journal.checkpoint import Checkpoint, Stand, State, Trigger

CHECKPOINTS: Final = "checkpoints"
CREATING: Final = ".creating"
KEPT: Final = 10
AGE_H: Final = 24
LOOKED_AT_MAX: Final = 64
_HOUR_NS: Final = 3_600 * 1_000_000_000


class Checkpoints(msgspec.Struct):
    """The checkpoints of one data folder. Every method blocks.

    `note` is told the name and what became of it: a state, or why it was passed over.
    """

    path: Path
    note: Callable[[str, str], object]
    kept: int = KEPT
    age_h: int = AGE_H

    @classmethod
    def of(
        cls, data: Path, note: Callable[[str, str], object], kept: int | None = None, age_h: int | None = None
    ) -> "Checkpoints":
        """Look at the checkpoints of a data folder; there need not be any."""
        return cls(data / CHECKPOINTS, note, kept or KEPT, age_h or AGE_H)

    def sweep(self) -> None:
        """Remove what a death has left half written. What can't be removed stays, and nobody reads it."""
        for left in self._named(f"*{CREATING}"):
            with suppress(OSError):
                left.unlink()
                self.note(left.name, checkpoint.after(State.CREATING, Trigger.LEFT))

    def keep(self, name: str, data: bytes) -> None:
        """Write a checkpoint; once this returns, a power cut does not lose it. Raises OSError, and then there is none."""
        self.path.mkdir(mode=0o700, exist_ok=True)
        fresh = self.path / (name + CREATING)
        try:
            with fresh.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            fresh.rename(self.path / name)
        except OSError:
            with suppress(OSError):
                fresh.unlink(missing_ok=True)
            raise
        self._flush()
        self.note(name, checkpoint.after(State.CREATING, Trigger.WRITTEN))
        self._expire(name)

    def newest(self, connection: Connection, now_ns: int) -> Checkpoint | None:
        """Return the newest one that is whole and of this book, as `connection` sees it at one moment.

        `now_ns` is wall time. Each that is passed over is noted.
        """
        head = queries.head(connection)
        for path in self._by_seq()[:LOOKED_AT_MAX]:
            found = self._read(path)
            if isinstance(found, Checkpoint):
                row = queries.event_row(connection, found.seq) if found.seq <= head.head_seq else None
                stand = Stand(head.head_seq, head.epoch, row.hash if row else None)
                why = checkpoint.misfit(found, stand, now_ns)
                if why is None:
                    return found
                found = why
            self.note(path.name, f"passed over: {found}")
        return None

    def _read(self, path: Path) -> Checkpoint | str:
        try:
            # Somebody may have put a pipe there: to open that as a file is would wait for ever.
            with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
                if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                    return "it is no file"
                data = file.read(checkpoint.BYTES_MAX + 1)
        except OSError as error:
            return f"it can't be read ({error.strerror})"
        if len(data) > checkpoint.BYTES_MAX:
            return "it is too large"
        return checkpoint.read(path.name, data)

    def _by_seq(self) -> list[Path]:
        found = [(seq, path) for path in self._named("*.json") if (seq := checkpoint.seq_of(path.name))]
        return [path for _, path in sorted(found, reverse=True)]

    def _expire(self, newest: str) -> None:
        """Remove what is beyond the number or the age that is kept."""
        oldest_ns = time.time_ns() - self.age_h * _HOUR_NS
        aged = sorted(((_written_ns(path), path) for path in self._by_seq()), reverse=True)
        others = [(written_ns, path) for written_ns, path in aged if path.name != newest]
        for place, (written_ns, path) in enumerate(others, 2):
            if place > self.kept or written_ns < oldest_ns:
                with suppress(OSError):  # what can't be removed is looked at again after the next one
                    path.unlink()
                    self.note(path.name, checkpoint.after(State.COMPLETE, Trigger.OLD))

    def _named(self, pattern: str) -> Iterator[Path]:
        with suppress(OSError):
            yield from self.path.glob(pattern)

    def _flush(self) -> None:
        fd = os.open(self.path, os.O_RDONLY)
        try:
            os.fsync(fd)
        finally:
            os.close(fd)


def _written_ns(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0
