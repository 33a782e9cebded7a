"""The guard's own log: JSON lines, bounded, rotated; control characters can't forge a line.

What a process of ours writes for years by itself (a core, a gateway, and what the interpreter prints for them) is copied
away and cut at its beginning while it runs: all of them append, so nobody has to reopen anything, and a C library's last
words are bounded too. A line written between the last look and the cut, some microseconds once in a megabyte, is lost;
nothing is decided by one. Not chosen: a rename, after which a process goes on writing to the old file without a bound.

A disk that takes no write takes no log either, and that is when one is wanted most: whatever writes one is then given
its place in the run folder, which is memory.
"""

import errno
import json
import os
import stat
import threading
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

LOG_BYTES_MAX = 1 << 20
OLD_LOGS_KEPT = 3
#: A log that grew beyond this before anybody looked is kept from here to its end.
CUT_BYTES_MAX = 4 << 20
#: How often the logs of others are looked at.
CUT_EVERY_S = 5.0
#: Lines that wait for a disk that does not take them.
WAITING_MAX = 1024
#: What a disk says that takes no write.
_REFUSED = frozenset({errno.EROFS, errno.EIO, errno.ENOSPC, errno.EDQUOT})
#: The exit code of a guard that a bug of its own has ended.
EXIT_BUG = 70


def rotate(path: Path) -> None:
    """Move `path` away if it has grown past its bound: log → log.1 → log.2 …, the oldest goes."""
    try:
        if path.stat().st_size < LOG_BYTES_MAX:
            return
    except FileNotFoundError:
        return
    path.replace(_make_room(path))


def _make_room(path: Path) -> Path:
    """Move the older logs one further; return the name that is free then."""
    for number in range(OLD_LOGS_KEPT - 1, 0, -1):
        older = path.with_name(f"{path.name}.{number}")
        if older.exists():
            older.replace(path.with_name(f"{path.name}.{number + 1}"))
    return path.with_name(f"{path.name}.1")


def cut(path: Path) -> None:
    """Copy away and empty a log that has grown past its bound, while others append to it. None there: nothing to do.

    Raises OSError where the copy can't be written; then nothing was cut.
    """
    try:
        fd = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except FileNotFoundError:
        return
    try:
        told = os.fstat(fd)
        if stat.S_ISREG(told.st_mode) and told.st_size >= LOG_BYTES_MAX:
            _copy_away(path, fd, max(0, told.st_size - CUT_BYTES_MAX))
            os.ftruncate(fd, 0)
    finally:
        os.close(fd)


def _copy_away(path: Path, fd: int, at: int) -> None:
    """Keep what stands from `at` on, also what is appended meanwhile, in place of the youngest older log."""
    part = path.with_name(f"{path.name}.part")
    copy = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    try:
        while sent := os.sendfile(copy, fd, at, CUT_BYTES_MAX):
            at += sent
        part.replace(_make_room(path))
        while sent := os.sendfile(copy, fd, at, CUT_BYTES_MAX):  # what came while the names were changed
            at += sent
    except OSError:
        part.unlink(missing_ok=True)  # a half copy takes room that is wanted
        raise
    finally:
        os.close(copy)


def place(path: Path, instead: Path) -> Path:
    """Return where this log can be written to now: at `path`, or under its name in the folder `instead`.

    Only while the disk refuses. Raises OSError for any other reason: where the folder is gone, so is what was in it,
    and nobody may be started there as if nothing were.
    """
    try:
        return _ready(path)
    except OSError as error:
        if error.errno not in _REFUSED:
            raise
        return _ready(instead / path.name)


def _ready(path: Path) -> Path:
    with suppress(OSError):  # a disk without room for a copy may have room for lines
        cut(path)
    os.close(_open(path))
    return path


def _open(path: Path) -> int:
    return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o600)


def end_with(reason: str) -> NoReturn:
    """End the process at once over a bug of ours: a guard that may be blind is worse than one started anew."""
    try:
        os.write(2, f"A fault of the guard's own: {reason}\n".encode("utf-8", "replace"))
    finally:
        os._exit(EXIT_BUG)


class LogFile:
    """Appends lines. Written from one thread only: the deciding loop never waits for a disk."""

    def __init__(self, path: Path, instead: Path | None = None) -> None:
        """Write to `path`; while that is refused under its name in the folder `instead`, if there is one."""
        self._paths = (path,) if instead is None else (path, instead / path.name)

    def append(self, entry: dict[str, object]) -> None:
        """Write one entry as one line. Disks that refuse must not stop the watch: the line is lost."""
        try:
            line = json.dumps(entry, ensure_ascii=False, default=str).encode("utf-8", "replace") + b"\n"
        except (ValueError, TypeError, RecursionError):
            return
        for path in self._paths:
            with suppress(OSError):
                _append(path, line)
                return


def _append(path: Path, line: bytes) -> None:
    rotate(path)
    fd = _open(path)
    try:
        os.write(fd, line)
    finally:
        os.close(fd)


class LogThread:
    """Takes lines from any thread without waiting, and writes them in their order on a thread of its own.

    While the disk does not take them a bounded number waits; those that came after are counted, not kept. Beside that
    it keeps the logs of others in their bounds.
    """

    def __init__(self, file: LogFile, others: Sequence[Path] = ()) -> None:
        """Begin. `others`: logs that processes of ours append to."""
        self._file = file
        self._others = tuple(others)
        self._waiting: deque[dict[str, object]] = deque()
        self._dropped = 0
        self._closed = False
        self._news = threading.Condition()
        self._thread = threading.Thread(target=self._write_on, name="log", daemon=True)
        self._thread.start()

    def add(self, entry: dict[str, object]) -> None:
        """Have one entry written, if there is room for it to wait."""
        with self._news:
            if len(self._waiting) < WAITING_MAX:
                self._waiting.append(entry)
            else:
                self._dropped += 1
            self._news.notify()

    def close(self, limit_s: float) -> bool:
        """Have what waits written, and wait for that no longer than `limit_s`; return whether it was."""
        with self._news:
            self._closed = True
            self._news.notify()
        self._thread.join(limit_s)
        return not self._thread.is_alive()

    def _write_on(self) -> None:
        while (batch := self._next()) is not None:
            for entry in batch:
                self._file.append(entry)
            for other in self._others:
                with suppress(OSError):  # it is tried again, and there may be room by then
                    cut(other)

    def _next(self) -> list[dict[str, object]] | None:
        """Return what waits, once something does or it is time to look at the others; None: closed, and all is written."""
        with self._news:
            self._news.wait_for(lambda: self._waiting or self._closed, CUT_EVERY_S)
            if self._closed and not self._waiting and not self._dropped:
                return None
            batch = list(self._waiting)
            self._waiting.clear()
            if self._dropped:
                batch.append({"kind": "dropped", "lines": self._dropped})
                self._dropped = 0
            return batch
