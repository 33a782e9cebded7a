"""Has a file read by a child process, and waits for it no longer than it may.

The ledger must not die of a spreadsheet. The child limits itself (`__main__`); this side starts it, hands it
the request through its standard input (the password is never in an argument, in the environment or on disk),
watches the clock, and reads its death as an answer when it gave none. A pool of readers was not chosen: a
reader that lives on would carry one person's password into the next one's import. Neither were asyncio's own
subprocesses: called off while they start, they are waited for without end (Python 3.11), and the kernel tells
of a death through a file descriptor anyway.
"""

import asyncio
import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Final

import msgspec

from core.imports.reading.kept import ReadTable, open_table
from core.imports.reading.lettering import ENCODINGS
from core.imports.reading.limits import PASSWORD_CHARACTERS_MAX, ReadingLimits
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
    formats: Path | None = None,
) -> ReadTable | Unreadable:
    """The table in the file at `path`, its rows written to `out`; or why there is none.

    `encoding` is a key of `lettering.ENCODINGS` or None; `password` opens a locked workbook and is kept
    nowhere; `formats` is a folder of layouts of the household's own. Must be awaited on the main thread's loop: the child dies with the thread that started it.
    Cancelled, it kills the child first. OSError if `path` can't be looked at or no process can be started.
    """
    size_bytes = path.stat().st_size
    if size_bytes > limits.file_bytes_max:
        return Unreadable(Why.TOO_LARGE)
    if size_bytes == 0:
        return Unreadable(Why.EMPTY)
    if encoding is not None and encoding not in ENCODINGS:
        return Unreadable(Why.UNKNOWN_ENCODING)
    if password is not None and len(password) > PASSWORD_CHARACTERS_MAX:
        return Unreadable(Why.WRONG_PASSWORD)
    request = Request(
        str(path.absolute()),
        str(out.absolute()),
        encoding,
        password,
        limits,
        os.getpid(),
        None if formats is None else str(formats.absolute()),
    )
    try:
        answer = await _ask(msgspec.json.encode(request), limits.wall_ms_max)
    finally:
        Path(f"{out}.part").unlink(missing_ok=True)
    return open_table(out) if answer is None else answer


async def _ask(request: bytes, wall_ms_max: int) -> Answer:
    child = _start(request)
    try:
        async with asyncio.timeout(wall_ms_max / 1_000):
            await _death_of(child)
    except TimeoutError:
        return Unreadable(Why.TOO_SLOW)
    finally:
        child.kill()
        # Off the loop: one that hangs on a dead disk is not gone at once, and nobody else shall wait for it.
        await asyncio.to_thread(child.wait)
        answer = _read_answer(child)
    return answer


def _start(request: bytes) -> "subprocess.Popen[bytes]":
    child = subprocess.Popen(
        (sys.executable, *_ARGUMENTS),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={name: os.environ[name] for name in _ENVIRONMENT if name in os.environ},
        bufsize=0,
    )
    assert child.stdin is not None
    # Two paths and a short password: the pipe takes it whole, and nobody waits here.
    with suppress(BrokenPipeError), child.stdin:
        child.stdin.write(request)
    return child


async def _death_of(child: "subprocess.Popen[bytes]") -> None:
    loop = asyncio.get_running_loop()
    gone = asyncio.Event()
    descriptor = os.pidfd_open(child.pid)
    loop.add_reader(descriptor, gone.set)
    try:
        await gone.wait()
    finally:
        loop.remove_reader(descriptor)
        os.close(descriptor)


def _read_answer(child: "subprocess.Popen[bytes]") -> Answer:
    """What the dead child had said; how it died, if it said nothing."""
    assert child.stdout is not None
    with child.stdout:
        said = child.stdout.read(_ANSWER_BYTES_MAX)
    if child.returncode == 0 and said:
        return msgspec.json.decode(said, type=Unreadable | None)
    return Unreadable(_DEATHS.get(child.returncode, Why.UNREADABLE))
