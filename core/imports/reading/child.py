"""Has a file read by a child process, and waits for it no longer than it may.

The ledger must not die of a spreadsheet. The child limits itself (`__main__`); this side starts it, hands it
the request through its standard input (the password is never in an argument, in the environment or on disk),
watches the clock, and reads its death as an answer when it gave none. A pool of readers was not chosen: a
reader that lives on would carry one person's password into the next one's import.
"""

import asyncio
import os
import signal
import sys
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

from core.imports.reading.kept import ReadTable, open_table
from core.imports.reading.limits import ReadingLimits
from core.imports.reading.request import Answer, Request
from core.imports.reading.table import Unreadable, Why

_ARGUMENTS: Final = ("-I", "-m", "core.imports.reading")
# What a Python may need to start; nothing of the guard's wires.
_ENVIRONMENT: Final = ("PATH", "LANG", "LD_LIBRARY_PATH")
_ANSWER_BYTES_MAX: Final = 4_096

_DEATHS: Final = {
    -signal.SIGXCPU: Why.TOO_SLOW,
    -signal.SIGALRM: Why.TOO_SLOW,
    # The workbook reader aborts when memory is refused to it; the kernel kills when the machine has none.
    -signal.SIGABRT: Why.OUT_OF_MEMORY,
    -signal.SIGKILL: Why.OUT_OF_MEMORY,
}


async def read_in_child(
    path: Path,
    *,
    encoding: str | None,
    password: str | None,
    out: Path,
    limits: ReadingLimits,
) -> ReadTable | Unreadable:
    """The table in the file at `path`, its rows written to `out`; or why there is none.

    `encoding` is a key of `lettering.ENCODINGS` or None; `password` opens a locked workbook and is kept
    nowhere. Must be awaited on the main thread's loop: the child dies with the thread that started it.
    Cancelled, it kills the child first. OSError if `path` can't be looked at or no process can be started.
    """
    size_bytes = path.stat().st_size
    if size_bytes > limits.file_bytes_max:
        return Unreadable(Why.TOO_LARGE)
    if size_bytes == 0:
        return Unreadable(Why.EMPTY)
    request = Request(str(path.absolute()), str(out.absolute()), encoding, password, limits, os.getpid())
    answer = await _ask(msgspec.json.encode(request), limits.wall_ms_max)
    if answer is not None:
        Path(f"{out}.part").unlink(missing_ok=True)
        return answer
    return open_table(out)


async def _ask(request: bytes, wall_ms_max: int) -> Answer:
    child = await asyncio.create_subprocess_exec(
        sys.executable,
        *_ARGUMENTS,
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
        env={name: os.environ[name] for name in _ENVIRONMENT if name in os.environ},
        limit=_ANSWER_BYTES_MAX,
    )
    try:
        async with asyncio.timeout(wall_ms_max / 1_000):
            return await _converse(child, request)
    except TimeoutError:
        return Unreadable(Why.TOO_SLOW)
    finally:
        with suppress(ProcessLookupError):
            child.kill()
        await child.wait()


async def _converse(child: asyncio.subprocess.Process, request: bytes) -> Answer:
    assert child.stdin is not None
    assert child.stdout is not None
    with suppress(BrokenPipeError, ConnectionResetError):
        child.stdin.write(request)
        await child.stdin.drain()
        child.stdin.close()
    line = await child.stdout.readline()
    status = await child.wait()
    if status == 0 and line:
        return msgspec.json.decode(line, type=Unreadable | None)
    return Unreadable(_DEATHS.get(status, Why.UNREADABLE))
