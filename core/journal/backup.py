"""A copy of the ledger before it is brought to a newer schema, because that way has no return.

It is made by the core that holds the ledger's lock at the fence, so nobody writes meanwhile, and only once it is on the
disk, was read again and has its name is a table changed. What could not be copied is not changed either. The newest
three are kept. Not chosen: a copy of the file, which would lack what still stands in the log, and whose opening beside
SQLite would cost its locks.
"""

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from core.guarded.privilege import has_reserve
from core.journal import disk
from core.journal.room import ROOM_BYTES_MIN, free_bytes
from core.journal.store import StoreError, StoreFault, copy_whole

BACKUPS: Final = "backups"
KEPT: Final = 3
_PATTERN: Final = "ledger-schema*-epoch*.db"


def backup_name(version: int, epoch: int) -> str:
    """Return what the copy of a ledger is called that stands at this schema and epoch."""
    return f"ledger-schema{version}-epoch{epoch}.db"


def back_up(
    ledger: Path, version: int, epoch: int, ledger_bytes: int, tick: Callable[[], object]
) -> StoreError | None:
    """Copy a ledger of `ledger_bytes` into the folder of backups beside it; return why it could not be done. Blocks.

    `tick` is called again and again meanwhile.
    """
    folder = ledger.parent / BACKUPS
    target = folder / backup_name(version, epoch)
    part = folder / f"{target.name}.part"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        error = _no_room(folder, ledger_bytes)
        if error is None:
            _make_empty(part)
            error = copy_whole(ledger, part, tick)
        if error is None:
            _settle(part, target)
            _tidy(folder)
    except OSError as raised:
        error = disk.refused(raised.errno or 0) or StoreError(
            StoreFault.OTHER, f"{raised.strerror}: {folder}"
        )
    if error is not None:
        for left in (part, part.with_name(f"{part.name}-journal")):
            with suppress(OSError):
                left.unlink(missing_ok=True)
    return error


def _no_room(folder: Path, wanted_bytes: int) -> StoreError | None:
    free = free_bytes(os.statvfs(folder), reserve_is_ours=has_reserve())
    if free is None or free >= wanted_bytes + ROOM_BYTES_MIN:
        return None
    return StoreError(StoreFault.NO_ROOM, f"ENOSPC: {free} bytes are free, a copy takes {wanted_bytes}")


def _make_empty(part: Path) -> None:
    """For its owner alone from its first moment, whatever the process's mask says."""
    part.unlink(missing_ok=True)
    os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))


def _settle(part: Path, target: Path) -> None:
    """Give it its name once it is on the disk, and the name as well."""
    _flush(part)
    part.replace(target)
    _flush(target.parent)


def _flush(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _tidy(folder: Path) -> None:
    newest_first = sorted(folder.glob(_PATTERN), key=lambda path: path.stat().st_mtime_ns, reverse=True)
    for old in newest_first[KEPT:]:
        old.unlink(missing_ok=True)
