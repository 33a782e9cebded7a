"""The guard's own log: JSON lines, bounded, rotated; control characters can't forge a line.

A disk that takes no write takes no log either, and that is when one is wanted most: whatever writes one is then given
its place in the run folder, which is memory.
"""

import errno
import json
import os
import threading
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

LOG_BYTES_MAX = 1 << 20
OLD_LOGS_KEPT = 3
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
    for number in range(OLD_LOGS_KEPT - 1, 0, -1):
        older = path.with_name(f"{path.name}.{number}")
        if older.exists():
            older.replace(path.with_name(f"{path.name}.{number + 1}"))
    path.replace(path.with_name(f"{path.name}.1"))


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
    rotate(path)
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

    While the disk does not take them a bounded number waits; those that came after are counted, not kept.
    """

    def __init__(self, file: LogFile) -> None:
        self._file = file
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
        while batch := self._next():
            for entry in batch:
                self._file.append(entry)

    def _next(self) -> list[dict[str, object]]:
        """Return what waits, once something does; nothing when the log is closed and all is written."""
        with self._news:
            self._news.wait_for(lambda: self._waiting or self._closed)
            batch = list(self._waiting)
            self._waiting.clear()
            if self._dropped:
                batch.append({"kind": "dropped", "lines": self._dropped})
                self._dropped = 0
            return batch
