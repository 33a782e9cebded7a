"""The guard's own log: JSON lines, bounded, rotated; control characters can't forge a line."""

import json
import os
from pathlib import Path

LOG_BYTES_MAX = 1 << 20
OLD_LOGS_KEPT = 3


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


class LogFile:
    """Appends lines. Written from the hands' thread only: the deciding loop never waits for a disk."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def append(self, entry: dict[str, object]) -> None:
        """Write one entry as one line. A disk that refuses must not stop the watch: the line is lost."""
        line = json.dumps(entry, ensure_ascii=False, default=str).encode() + b"\n"
        try:
            rotate(self._path)
            fd = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o600)
            try:
                os.write(fd, line)
            finally:
                os.close(fd)
        except OSError:
            return
