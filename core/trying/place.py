"""The place of a trial: a folder under DIR/trials, held by a lock as long as anybody is at work in it.

Whoever dies leaves his folder, and the next one removes it. That he is dead is told by the lock on the folder alone, which
the kernel gives back when the last process that has it is gone, a forked core of his included; a number of a process
may belong to somebody else by now. Not chosen: a folder of the system's temporary files, which may lie in memory, where a
copy of a ledger has no room, or on another disk, where whoever looks for what takes the room does not find it.
"""

import fcntl
import os
import shutil
import uuid
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

TRIALS: Final = "trials"


class Place(msgspec.Struct, frozen=True):
    """A folder of one's own; `lock` is a descriptor that every fork of its owner shares."""

    path: Path
    lock: int

    def remove(self) -> None:
        """Remove it with all that is in it, and let go of it. What can't be removed is left to the next one."""
        shutil.rmtree(self.path, ignore_errors=True)
        os.close(self.lock)


def take_place(data: Path) -> Place:
    """Make a folder in a data folder, for its owner alone. OSError where the disk takes none."""
    trials = data / TRIALS
    trials.mkdir(mode=0o700, exist_ok=True)
    while True:
        path = trials / uuid.uuid4().hex
        path.mkdir(mode=0o700)
        lock = _hold(path)
        # Between the two lines above another one may have taken the folder for a dead one's.
        if lock is not None and path.exists():
            return Place(path, lock)
        if lock is not None:
            os.close(lock)


def clear_up(data: Path) -> int:
    """Remove what the dead have left in a data folder; return how many folders that were."""
    removed = 0
    with suppress(OSError):
        for path in (data / TRIALS).iterdir():
            lock = _hold(path)
            if lock is None:
                continue
            shutil.rmtree(path, ignore_errors=True)
            os.close(lock)
            removed += 1
    return removed


def _hold(path: Path) -> int | None:
    """Lock a folder; None: somebody is at work in it, or it is no folder (any more)."""
    try:
        lock = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(lock)
        return None
    return lock
