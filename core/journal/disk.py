"""Whether the store's disk takes a write of our own, asked when the store has failed.

What SQLite says of a disk that has turned read-only, or that fails, depends on where it met that: an error of COMMIT,
of a lock, of the shared index, a file that can't be opened. None of it is a fact about the disk, and the mount's own
word is none either: a file system that has met an error may still be called writable while it refuses every write
(measured: ext4 with errors=remount-ro). A small new file, flushed and removed, is one. It is never written where all
is well, because a flush costs what a transaction costs.
"""

import errno
import os
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Final

from core.journal.lock import LOCK_FILE
from core.journal.store import StoreError, StoreFault

PROBE_FILE: Final = ".core-probe"
PROBE_BYTES: Final = 4096

_FAULTS: Final = MappingProxyType(
    {
        errno.EROFS: StoreFault.READ_ONLY,
        errno.EIO: StoreFault.READ_ONLY,
        errno.ENOSPC: StoreFault.NO_ROOM,
        errno.EDQUOT: StoreFault.NO_ROOM,
    }
)


def refused(number: int) -> StoreError | None:
    """Return what an error of the system says of its disk; None: it is about something else."""
    fault = _FAULTS.get(number)
    if fault is None:
        return None
    return StoreError(fault, f"{errno.errorcode[number]}: {os.strerror(number)}")


def refusal(folder: Path) -> StoreError | None:
    """Write a small file into `folder` and remove it; return why the disk does not take it. Blocks."""
    probe = folder / PROBE_FILE
    try:
        descriptor = os.open(probe, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
        try:
            os.write(descriptor, bytes(PROBE_BYTES))
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
            with suppress(OSError):
                probe.unlink()
    except OSError as error:
        return refused(error.errno or 0)
    return None


def refuses_to_open(folder: Path) -> StoreError | None:
    """Open the lock in `folder` for writing, and no more; return why its disk refuses that. Two system calls."""
    try:
        os.close(os.open(folder / LOCK_FILE, os.O_WRONLY | os.O_CLOEXEC))
    except OSError as error:
        return refused(error.errno or 0)
    return None
