"""Who holds which lock in the data folder: the kernel's table of locks, joined with the files by their numbers.

No file of the folder is opened for it: closing any descriptor of a database drops the locks that the same
process has on it, and a guard must not even be able to. The reading of the table is `host/locks`.
"""

import os
from pathlib import Path
from typing import Any

from msgspec import structs

from hardcore.host import locks
from hardcore.snapshot.aside import Aside
from hardcore.snapshot.form import as_bytes
from hardcore.snapshot.subject import Haul, Subject

#: Files of the folder whose locks are looked for.
FILES_MAX = 64

Table = Aside[tuple[locks.FileLock, ...] | str]


def begin_table() -> Table:
    """Begin to read the kernel's table of locks."""
    return Aside(locks.read_table)


def collect_locks(subject: Subject, haul: Haul, looked: Table, until_ns: int) -> None:
    """Find the holders of the locks on the data folder's files, and who has the store's write lock."""
    table = looked.wait(until_ns)
    if isinstance(table, str):
        haul.missing["locks.json"] = f"the kernel's table of locks: {table}"
        return
    writers = locks.writers_in(subject.data, subject.pid, table)
    told = {
        "store_write_lock": [structs.asdict(holder) for holder in writers],
        "files": {path.name: held for path in _files(subject.data) if (held := _held(path, table))},
    }
    haul.files["locks.json"] = as_bytes(told)


def _files(data: Path) -> list[Path]:
    try:
        with os.scandir(data) as items:
            names = [item.name for _, item in zip(range(FILES_MAX), items, strict=False) if item.is_file()]
    except OSError:
        return []
    return [data / name for name in sorted(names)]


def _held(path: Path, table: tuple[locks.FileLock, ...]) -> list[dict[str, Any]]:
    return [
        {
            "kind": lock.kind,
            "pid": lock.pid,
            "name": locks.name_of(lock.pid),
            "writes": lock.writes,
            "waits": lock.waits,
            "start": lock.start,
            "end": lock.end,
        }
        for lock in locks.locks_on(path, table)
    ]
