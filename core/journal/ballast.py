"""The ballast: 8 MiB that lie allocated beside the ledger, for one write that must not fail for want of room.

A disk may be full at the very moment when a core has to raise the epoch, because of somebody else's files. Without that
nobody may be told what became of his last request: what the dead core wrote last may not last. The ballast is dropped
then and the fence tried once more. What comes of it is a core that knows, and takes entries as soon as there is room,
or at once where nobody wants more room than is left of the ballast. A serving core lays it down again when there is
plenty. Only the fence drops it: an ordinary write that finds no room is refused, is certainly not done, and costs nobody
his ledger; it would eat the ballast bit by bit and leave the fence none.
"""

import asyncio
import os
from contextlib import suppress
from pathlib import Path
from typing import Final, NoReturn

from core.guarded.privilege import has_reserve
from core.journal.room import free_bytes

BALLAST_FILE: Final = "ballast"
BALLAST_BYTES: Final = 8 << 20
#: It is laid down only where so much is free: what stays free beside it is twice what a guard calls a full disk
#: (16 MiB, `sentinel/patience.py`), so that the ballast itself never makes one.
ROOM_BYTES: Final = BALLAST_BYTES + (32 << 20)

_BLOCK_BYTES: Final = 512  # the unit of `st_blocks`, whatever the file system's own is


def drop(data: Path) -> bool:
    """Free the room of the ballast in a data folder; return whether there was any."""
    path = data / BALLAST_FILE
    try:
        held = path.stat().st_blocks > 0
        path.unlink()
    except OSError:
        return False
    return held


def lay_down(data: Path) -> bool:
    """Allocate the ballast where it is missing and there is room; return whether it lies there now. Blocks."""
    path = data / BALLAST_FILE
    try:
        if _is_laid(path):
            return True
        free = free_bytes(os.statvfs(data), reserve_is_ours=has_reserve())
        if free is not None and free < ROOM_BYTES:
            return False
        _allocate(path)
    except OSError:
        with suppress(OSError):
            path.unlink(missing_ok=True)  # half of it would only take room
        return False
    return True


def _is_laid(path: Path) -> bool:
    """Whether it takes its room: a copy of it, which is all zeros, may be long and take none."""
    try:
        seen = path.stat()
    except FileNotFoundError:
        return False
    return seen.st_size == BALLAST_BYTES and seen.st_blocks * _BLOCK_BYTES >= BALLAST_BYTES


async def keep_laid(data: Path, after_ms: int, every_ms: int) -> NoReturn:
    """See to it, while a core serves, that the ballast lies there: first after a rest, then again and again."""
    await asyncio.sleep(after_ms / 1000)
    while True:
        await asyncio.to_thread(lay_down, data)
        await asyncio.sleep(every_ms / 1000)


def _allocate(path: Path) -> None:
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        os.posix_fallocate(descriptor, 0, BALLAST_BYTES)
    finally:
        os.close(descriptor)
