"""Whether the store's disk takes a write now, asked before anything is written.

In a log that is written at COMMIT, a full disk is met at COMMIT and nowhere before it (measured: BEGIN, UPDATE
and INSERT all succeed on a disk without a free block), and a COMMIT that raised is one of which nobody knows what
became. So a batch that has something to write looks at the file system first. Too little room then means that
nothing was done, which is certain, and that the core can go on serving reads. It costs three system calls. What
counts is what this very process may write, and a guard on the same disk counts alike, or it would have the core
try what the core refuses by itself. A quota, or a disk that fills up between this look and the COMMIT, is met
where it always was. For the one write that can't be refused so, the fence, a file of room is kept (`ballast.py`). It
was not chosen for ordinary batches: freed for one of them, it is gone for the fence, and a batch that is certainly not
done costs a sentence only.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Final

from core.guarded.privilege import has_reserve
from core.journal.disk import refuses_to_open
from core.journal.store import StoreError, StoreFault

#: More than an ordinary batch and its checkpoint write; a batch of larger bodies asks for more.
ROOM_BYTES_MIN: Final = 512 << 10


def free_bytes(seen: os.statvfs_result, *, reserve_is_ours: bool) -> int | None:
    """Return how much may be written; None where the file system does not tell its size, as some in user space.

    `reserve_is_ours`: what is kept back for the superuser is room too.
    """
    if seen.f_blocks == 0:
        return None
    return (seen.f_bfree if reserve_is_ours else seen.f_bavail) * seen.f_frsize


class Room:
    """The room on the file system of one folder, or the boundless one of a book in memory. Any thread."""

    def __init__(self, folder: Path | None, now_ns: Callable[[], int]) -> None:
        """Look at the file system of `folder`, None: in memory; `now_ns` is monotonic."""
        self._folder = folder
        self._now_ns = now_ns
        self._full_until_ns = 0
        self._reserve_is_ours = has_reserve()

    def pretend_full(self, until_ns: int) -> None:
        """Answer as a full disk would until `until_ns`, monotonic: a drill."""
        self._full_until_ns = until_ns

    def fault(self, bytes_needed: int = 0) -> StoreError | None:
        """Return why nothing can be written now, None where `bytes_needed` and what is always kept free fit."""
        if self._now_ns() < self._full_until_ns:
            return StoreError(StoreFault.NO_ROOM, "SQLITE_FULL: a drill says that the disk is full")
        if self._folder is None:
            return None
        try:
            seen = os.statvfs(self._folder)
        except OSError:
            return None  # what can't be looked at is met by the write itself
        if seen.f_flag & os.ST_RDONLY:
            return StoreError(StoreFault.READ_ONLY, "EROFS: the disk is mounted read-only")
        # One that has met an error may still be called writable, and refuse everybody: that shows at an opening.
        if (refused := refuses_to_open(self._folder)) is not None:
            return refused
        free = free_bytes(seen, reserve_is_ours=self._reserve_is_ours)
        if free is not None and free < ROOM_BYTES_MIN + bytes_needed:
            return StoreError(StoreFault.NO_ROOM, f"ENOSPC: {free} bytes are free on the ledger's disk")
        return None
