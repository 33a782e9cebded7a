"""Who holds a lock on which file, from the kernel's own table: the files themselves are never opened.

`/proc/locks` names device, inode, byte range and owner of every lock of the machine; a `stat` of our files says
which lines are ours. Asking by `fcntl(F_GETLK)` was not chosen: it needs the file open, and closing any descriptor
of a database file drops the locks that the same process holds on it. Some file systems tell another device number
to `stat` than to the table; there a line counts only if its owner has our very file open.
"""

import os
from collections.abc import Iterable
from itertools import islice
from pathlib import Path

import msgspec

from hardcore.model.looks import LockHolder

TABLE_BYTES_MAX = 1 << 20
#: Holders of one lock that are named; a write lock has one, and a table read in the middle of a change two.
HOLDERS_MAX = 8
#: Open files of one process that are compared where the device numbers differ.
HANDLES_MAX = 4096
#: Files of a folder that are looked at; a data folder has a dozen.
FILES_MAX = 64
NAME_BYTES_MAX = 64

#: Where SQLite locks: the writer of a log in the index beside it, a writer without a log in the file.
_WAL_WRITE_BYTE = 120
_PENDING_BYTE, _RESERVED_BYTE = 0x40000000, 0x40000001

_TABLE = Path("/proc/locks")


class FileLock(msgspec.Struct, frozen=True):
    """One line of the kernel's table. `pid` 0: the owner has no number here. `end` None: to the end of the file."""

    kind: str  # POSIX, OFDLCK, or FLOCK, which the other two don't see
    device: tuple[int, int]
    inode: int
    pid: int
    writes: bool
    waits: bool  # it is asked for, and not had
    start: int
    end: int | None

    def covers(self, byte: int) -> bool:
        """Tell whether the byte at this offset is in it."""
        return self.start <= byte and (self.end is None or byte <= self.end)


def parse(table: str) -> tuple[FileLock, ...]:
    """Return the locks in the text of `/proc/locks`; a line that is not understood is left out."""
    return tuple(lock for line in table.splitlines() if (lock := _parse_line(line)) is not None)


def _parse_line(line: str) -> FileLock | None:
    words = line.split()
    waits = words[1:2] == ["->"]
    if waits:
        del words[1]
    if len(words) != 8 or words[1] not in {"POSIX", "OFDLCK", "FLOCK"}:
        return None
    where = words[5].split(":")
    try:
        return FileLock(
            kind=words[1],
            device=(int(where[0], 16), int(where[1], 16)),
            inode=int(where[2]),
            pid=max(0, int(words[4])),  # a lock that belongs to an open file has -1
            writes=words[3] == "WRITE",
            waits=waits,
            start=int(words[6]),
            end=None if words[7] == "EOF" else int(words[7]),
        )
    except (ValueError, IndexError):
        return None


def read_table() -> tuple[FileLock, ...] | str:
    """Return all locks of this machine that may be seen from here, or why they can't be read."""
    try:
        with _TABLE.open("rb") as file:
            return parse(file.read(TABLE_BYTES_MAX).decode("ascii", "replace"))
    except OSError as error:
        return error.strerror or "unreadable"


def locks_on(path: Path, table: Iterable[FileLock]) -> tuple[FileLock, ...]:
    """Return the locks on the file at `path`: held ones and, marked, those that are waited for."""
    try:
        about = path.stat()
    except OSError:
        return ()
    device = (os.major(about.st_dev), os.minor(about.st_dev))
    same = [lock for lock in table if lock.inode == about.st_ino]
    return tuple(lock for lock in same if lock.device == device or _has_open(lock.pid, about))


def _has_open(pid: int, about: os.stat_result) -> bool:
    """Tell whether the process has this very file open, under whatever device number."""
    if not pid:
        return False
    try:
        with os.scandir(f"/proc/{pid}/fd") as entries:
            handles = [entry.path for entry in islice(entries, HANDLES_MAX)]
    except OSError:
        return False
    return any(_same_file(handle, about) for handle in handles)


def _same_file(handle: str, about: os.stat_result) -> bool:
    try:
        return os.path.samestat(Path(handle).stat(), about)
    except OSError:
        return False


def writers_in(folder: Path, core_pid: int, table: Iterable[FileLock]) -> tuple[LockHolder, ...]:
    """Return who holds the write lock of the SQLite database in `folder`, with a log or without one.

    Which file that is, is told by its locks: the name of the ledger's file is nobody's business here.
    """
    table = tuple(lock for lock in table if lock.writes and not lock.waits and lock.kind != "FLOCK")
    pids: dict[int, None] = {}
    for path in _files(folder):
        marks = (_WAL_WRITE_BYTE,) if path.name.endswith("-shm") else (_PENDING_BYTE, _RESERVED_BYTE)
        for lock in locks_on(path, table):
            if any(lock.covers(byte) for byte in marks):
                pids[lock.pid] = None
    return tuple(LockHolder(pid, name_of(pid), ours=pid == core_pid) for pid in list(pids)[:HOLDERS_MAX])


def _files(folder: Path) -> list[Path]:
    try:
        with os.scandir(folder) as entries:
            return [Path(entry.path) for entry in islice(entries, FILES_MAX) if entry.is_file()]
    except OSError:
        return []


def name_of(pid: int) -> str:
    """Return the name of the program that has this pid now, fit for a line; empty when there is none."""
    if not pid:
        return ""
    try:
        with Path(f"/proc/{pid}/comm").open("rb") as file:
            name = file.read(NAME_BYTES_MAX).decode("utf-8", "replace")
    except OSError:
        return ""
    return "".join(letter for letter in name if letter.isprintable())
