"""The start guard: one sentence instead of two cores by accident.

A lock on `ledger.lock` beside the book: a core that runs alone takes it for itself, cores under a guard share
it (the guard sees to it that one of them writes). It is a courtesy at the door and never the fence: a frozen
owner keeps it, a forked child inherits it, and only the epoch inside the transaction decides who may commit.
The file is never unlinked: two owners of two inodes with one name was the trap.
"""

import errno
import fcntl
import os
from pathlib import Path
from typing import Final

import msgspec

LOCK_FILE: Final = "ledger.lock"


class StartGuard(msgspec.Struct, frozen=True):
    """The lock, held until this is let go or the process ends."""

    descriptor: int

    def release(self) -> None:
        """Let the next one in."""
        os.close(self.descriptor)


class DoorClosed(msgspec.Struct, frozen=True):
    """The lock could not be had; the sentence says why and what to do. `number` is the system's, 0 without one."""

    sentence: str
    number: int = 0


def take_start_guard(data: Path, *, shared: bool, reading: bool = False) -> StartGuard | DoorClosed:
    """Take the lock of a data folder, shared with other guarded cores or alone.

    `reading`: for a core that writes nothing; the lock is taken as it lies there, on a disk that takes no write.
    """
    path = data / LOCK_FILE
    access = os.O_RDONLY if reading else os.O_RDWR | os.O_CREAT
    try:
        descriptor = os.open(path, access | os.O_CLOEXEC, 0o600)
    except OSError as error:
        if reading:
            return DoorClosed(f"{path} can't be opened ({error.strerror}): there is no ledger to read.")
        return DoorClosed(
            f"{data} can't be written to ({error.strerror}): choose another folder with --data.",
            error.errno or 0,
        )
    try:
        fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except OSError as error:
        os.close(descriptor)
        if error.errno != errno.EWOULDBLOCK:
            return DoorClosed(f"{path} can't be locked ({error.strerror}): choose a folder on a local disk.")
        other = "A core that runs alone" if shared else "Another core"
        return DoorClosed(
            f"{other} is already at work in {data}: stop it, or choose another folder with --data."
        )
    return StartGuard(descriptor)
