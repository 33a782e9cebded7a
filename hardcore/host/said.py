"""What a process that has ended said last: the end of its log, in one line, without waiting for a disk.

A core that can't even be imported has no page and no last words, but Python has told its log why. Whoever decides
reads it at the moment of the end, so the file is held open from the start and read with RWF_NOWAIT: what a disk would
have to be waited for stays unsaid. Not chosen: a pipe, whose end may be held by others; a thread, which would make
the end itself wait.
"""

import errno
import os
import re
from pathlib import Path

TAIL_BYTES_MAX = 8192
LINE_CHARS_MAX = 200

#: The last line of a traceback: the kind of error, and what it says of itself.
_ERROR = re.compile(r"(?:\w+\.)*(\w*(?:Error|Exception|Interrupt|Exit))(?:: (.*))?")
_PLACE = re.compile(r'\s+File "([^"]+)", line (\d+)')
#: Frames of the import system say nothing about the file that could not be imported.
_FROZEN = "<frozen "


class LogEnd:
    """Reads what is appended to a log from now on. Other processes may append to it too."""

    def __init__(self, path: Path) -> None:
        """Hold the log open. Raises OSError when it can't be."""
        self._fd = os.open(path, os.O_RDONLY | os.O_CREAT | os.O_CLOEXEC, 0o600)
        self._from = os.fstat(self._fd).st_size

    def last_said(self) -> str:
        """Return the last thing said in one line, or an empty text if that is not to be had at once."""
        try:
            end = os.fstat(self._fd).st_size
            if end < self._from:
                self._from = 0  # it was cut since
            begin = max(self._from, end - TAIL_BYTES_MAX)
            tail = _read_now(self._fd, max(0, end - begin), begin)
        except OSError:
            return ""
        return in_one_line(tail.decode("utf-8", "replace"))

    def close(self) -> None:
        """Let go of the log."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1


def _read_now(fd: int, count: int, offset: int) -> bytes:
    buffer = bytearray(count)
    try:
        got = os.preadv(fd, [buffer], offset, os.RWF_NOWAIT)
    except OSError as error:
        if error.errno != errno.EOPNOTSUPP:
            raise
        got = os.preadv(fd, [buffer], offset)  # a tmpfs: there is nothing to wait for
    return bytes(buffer[:got])


def in_one_line(log: str) -> str:
    """Return the last error of a log with its place, or its last line."""
    lines = [line for line in log.splitlines() if line.strip()]
    for at in range(len(lines) - 1, -1, -1):
        if found := _ERROR.fullmatch(lines[at].rstrip()):
            place = _place(lines[:at])
            said = found[1] + (f": {found[2]}" if found[2] else "")
            return _cut(said, f" ({place})" if place else "")
    return _cut(lines[-1].strip()) if lines else ""


def _place(before: list[str]) -> str:
    """Return where the error was raised: the last place that the traceback above it names."""
    for line in reversed(before):
        place = _PLACE.match(line)
        if place and not place[1].startswith(_FROZEN):
            return f"{'/'.join(Path(place[1]).parts[-2:])}, line {place[2]}"
    return ""


def _cut(words: str, behind: str = "") -> str:
    room = LINE_CHARS_MAX - len(behind)
    shown = "".join(each if each.isprintable() else " " for each in words)
    return (shown if len(shown) <= room else f"{shown[: room - 1]}…") + behind
