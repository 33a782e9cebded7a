"""A copy of the ledger before it is brought to a newer schema, because that way has no return.

It is made by the core that holds the ledger's lock at the fence, so nobody writes meanwhile, and only once it is on the
disk, was read again and has its name is a table changed. What could not be copied is not changed either. A start that
died after that finds its copy and makes no second one, or a disk with room for one would never see the ledger again.
Room is asked for copy and step together, before either. The newest three are kept, by what they are called: a clock may
have been wrong. Not chosen: a copy of the file, which would lack what still stands in the log, and whose opening beside
SQLite would cost its locks.
"""

import os
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

from core.guarded.privilege import has_reserve
from core.journal import disk
from core.journal.room import ROOM_BYTES_MIN, free_bytes
from core.journal.store import StoreError, StoreFault, copy_whole, is_copy

BACKUPS: Final = "backups"
KEPT: Final = 3
_NAMED: Final = re.compile(r"ledger-schema(\d+)-epoch(\d+)\.db")
_PARTS: Final = "ledger-schema*-epoch*.db.part*"  # and what SQLite lays beside one


def backup_name(version: int, epoch: int) -> str:
    """Return what the copy of a ledger is called that stands at this schema and epoch."""
    return f"ledger-schema{version}-epoch{epoch}.db"


def newest_backup(data: Path) -> Path | None:
    """Return the newest copy that is kept in a data folder, by what it is called; None without one."""
    try:
        kept = [path for path in (data / BACKUPS).iterdir() if _NAMED.fullmatch(path.name)]
    except OSError:
        return None
    return max(kept, key=_age, default=None)


def back_up(
    ledger: Path, version: int, epoch: int, ledger_bytes: int, step_bytes: int, tick: Callable[[], object]
) -> StoreError | None:
    """See that a copy of a ledger of `ledger_bytes` lies in the folder of backups beside it; return why there is none.

    `version` and `epoch` are those of the ledger; `step_bytes` is what bringing it up will take, for which there must be
    room too. `tick` is called again and again meanwhile. Blocks.
    """
    folder = ledger.parent / BACKUPS
    target = folder / backup_name(version, epoch)
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        _clear_up(folder)
        if is_copy(target, ledger, tick):
            error = _no_room(folder, step_bytes)
        else:
            target.unlink(missing_ok=True)
            error = _no_room(folder, ledger_bytes + step_bytes) or _copy(ledger, target, tick)
        if error is None:
            flush(target)
            flush(folder)
            _tidy(folder, target)
    except OSError as raised:
        error = disk.refused(raised.errno or 0) or StoreError(
            StoreFault.OTHER, f"{raised.strerror}: {folder}"
        )
    if error is not None:
        with suppress(OSError):
            _clear_up(folder)
    return error


def _clear_up(folder: Path) -> None:
    """Remove what a death has left half-way: nobody else is at work here, the ledger's lock is held."""
    for part in folder.glob(_PARTS):
        part.unlink(missing_ok=True)


def _no_room(folder: Path, wanted_bytes: int) -> StoreError | None:
    free = free_bytes(os.statvfs(folder), reserve_is_ours=has_reserve())
    if free is None or free >= wanted_bytes + ROOM_BYTES_MIN:
        return None
    text = f"ENOSPC: {free} bytes are free, to keep and to change it takes {wanted_bytes}"
    return StoreError(StoreFault.NO_ROOM, text)


def _copy(ledger: Path, target: Path, tick: Callable[[], object]) -> StoreError | None:
    """Copy the ledger, and give the copy its name once it is on the disk."""
    part = target.with_name(f"{target.name}.part")
    _make_empty(part)
    error = copy_whole(ledger, part, tick)
    if error is None:
        flush(part)
        part.replace(target)
    return error


def _make_empty(part: Path) -> None:
    """For its owner alone from its first moment, whatever the process's mask says."""
    os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))


def flush(path: Path) -> None:
    """Have what stands in a file, or the names in a folder, on the disk."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _tidy(folder: Path, target: Path) -> None:
    """Remove the oldest. `target` is the newest, whatever others that were laid here are called."""
    others = [path for path in folder.iterdir() if _NAMED.fullmatch(path.name) and path != target]
    for old in sorted(others, key=_age)[: -(KEPT - 1)]:
        old.unlink(missing_ok=True)


def _age(copy: Path) -> tuple[int, int]:
    named = _NAMED.fullmatch(copy.name)
    assert named is not None, "only copies are sorted"
    return int(named[1]), int(named[2])
