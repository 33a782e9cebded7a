"""The reading child: takes one request on its standard input, writes one table, answers, and is gone.

It ties its own hands before it opens the file: memory, processor time, size of what it writes, no core dump
(which would hold the password), and it dies with its parent. It runs kindly (nice) and is the first to go
when the machine's memory ends. Limits set by the parent between fork and exec were not chosen: code that runs
there in a process with threads can hang it.
"""

import os
import resource
import signal
import sys
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

from core.imports.reading.kept import write_table
from core.imports.reading.limits import ReadingLimits
from core.imports.reading.own_formats import known_formats
from core.imports.reading.request import Answer, Request
from core.imports.reading.table import Unreadable, Why
from core.mortality import die_with

_OPEN_FILES_MAX: Final = 64
_NICE: Final = 10
_OOM_SCORE: Final = "900"
_GRACE_S: Final = 1
# Given back when memory ends, so that there is some left to say so: what was read is still held by the traceback.
_LAST_WORDS_BYTES: Final = 4 << 20
# A library that finds no room to be mapped into is told as one that can't be imported. Made early: that takes memory.
_NO_ROOM: Final = (MemoryError, ImportError)


def main() -> None:
    """Read what standard input asks for."""
    request = msgspec.json.decode(sys.stdin.buffer.read(), type=Request)
    if not die_with(request.parent):
        sys.exit(1)
    _limit(request.limits)
    sys.stdout.buffer.write(msgspec.json.encode(_answer(request)) + b"\n")
    sys.stdout.flush()


def _limit(limits: ReadingLimits) -> None:
    for kind, most in (
        (resource.RLIMIT_AS, limits.address_space_bytes_max),
        (resource.RLIMIT_FSIZE, limits.rows_bytes_max + (1 << 20)),
        (resource.RLIMIT_CORE, 0),
        (resource.RLIMIT_NOFILE, _OPEN_FILES_MAX),
    ):
        resource.setrlimit(kind, (most, most))
    resource.setrlimit(resource.RLIMIT_CPU, (limits.cpu_s_max, limits.cpu_s_max + _GRACE_S))
    # The wall clock is the parent's to watch; this one is for a parent that is stopped.
    signal.alarm(limits.wall_ms_max // 1_000 + _GRACE_S)
    os.umask(0o077)
    os.nice(_NICE)
    with suppress(OSError):  # some sandboxes mount /proc read-only; the limits above hold without it
        Path("/proc/self/oom_score_adj").write_text(_OOM_SCORE, "ascii")


def _answer(request: Request) -> Answer:
    kept = bytearray(_LAST_WORDS_BYTES)
    try:
        return _read(request)
    except _NO_ROOM:
        kept.clear()
        return Unreadable(Why.OUT_OF_MEMORY)
    # Also what isn't an Exception: a panic of the workbook reader comes as a BaseException of its own.
    except BaseException:  # noqa: BLE001 - the reason stands above
        kept.clear()
        return Unreadable(Why.UNREADABLE)


def _read(request: Request) -> Answer:
    # Only now, under the limits: these bring the parsers with them.
    from core.imports.reading.readout import read

    limits = request.limits
    with Path(request.path).open("rb") as file:
        data = file.read(limits.file_bytes_max + 1)
    formats = known_formats(Path(request.formats) if request.formats else None).formats.values()
    made = read(data, formats, limits, encoding=request.encoding, password=request.password)
    if isinstance(made, Unreadable):
        return made
    part = Path(request.out + ".part")
    refused = write_table(part, made.head, made.lines, limits.rows_bytes_max)
    if refused is None:
        part.replace(request.out)
    return refused


if __name__ == "__main__":
    main()
