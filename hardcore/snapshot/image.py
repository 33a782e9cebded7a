"""A memory image of a stopped core (gcore): the one piece of evidence that may cost seconds and gigabytes.

So it stands on its own, behind everything else: it is begun when the bundle is on disk, has a budget of its own,
is not begun if memory is larger than the policy allows or the disk would get full of it, and is ended when it
grows past what was promised. Only of a core that is stopped anyway: a debugger that is killed halfway can leave
a process standing still. An image holds every secret of the process; no sieve can go through it, and so it is
never written unless the policy says so, is its owner's alone and leaves the machine with nobody.
"""

import os
import time
from pathlib import Path

import msgspec

from hardcore.snapshot import children, memory
from hardcore.snapshot.subject import Subject, Tools

#: What a full disk must still be left with: the next evidence, the ledger's own log.
FREE_BYTES_MIN = 256 << 20
OUTPUT_BYTES_MAX = 1 << 20


class ImageLimits(msgspec.Struct, frozen=True):
    """What a memory image may cost: time in milliseconds, which the kill waits for, and bytes of memory."""

    budget_ms: int
    bytes_max: int


def write_image(subject: Subject, tools: Tools, folder: Path, limits: ImageLimits) -> Path | str:
    """Write the process's memory into `folder`; return the file, or why there is none.

    Blocks up to the budget and the disk's own time. Nothing is left in the folder where there is none.
    """
    if tools.gcore is None:
        return "gcore is not installed"
    if (why := _too_large(subject.pid, folder, limits.bytes_max)) is not None:
        return why
    written = folder / f".core.{subject.pid}"
    until_ns = time.monotonic_ns() + limits.budget_ms * 1_000_000
    why = _run(tools.gcore, subject.pid, written, until_ns, limits.bytes_max)
    if why is None:
        why = _sync(written)
    if why is not None:
        written.unlink(missing_ok=True)
        return why
    return written


def _too_large(pid: int, folder: Path, bytes_max: int) -> str | None:
    sizes = memory.status_sizes(pid)
    if "VmRSS" not in sizes:
        return "the process was gone"
    held_bytes = sizes["VmRSS"] + sizes.get("VmSwap", 0)
    if held_bytes > bytes_max:
        return f"its memory has {held_bytes} bytes, the policy allows {bytes_max}"
    try:
        disk = os.statvfs(folder)
    except OSError as error:
        return f"the disk would not tell its room: {error.strerror}"
    free_bytes = disk.f_bavail * disk.f_frsize
    if free_bytes < held_bytes + FREE_BYTES_MIN:
        return f"the disk has {free_bytes} bytes free, an image and what must stay free need more"
    return None


def _run(gcore: Path, pid: int, written: Path, until_ns: int, bytes_max: int) -> str | None:
    """Run gcore; None: its file stands whole, for its owner only."""

    def grows() -> str | None:
        try:
            size_bytes = written.stat().st_blocks * 512
        except OSError:
            return None  # not begun yet
        return f"it grew over {bytes_max} bytes" if size_bytes > bytes_max else None

    child = children.start([str(gcore), "-o", str(written.with_suffix("")), str(pid)])
    if isinstance(child, str):
        return f"gcore: {child}"
    told = children.finish(child, until_ns, OUTPUT_BYTES_MAX, grows)
    return f"gcore: {told}" if isinstance(told, str) else None


def _sync(written: Path) -> str | None:
    try:
        handle = os.open(written, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
        try:
            os.fchmod(handle, 0o600)
            os.fsync(handle)
        finally:
            os.close(handle)
    except OSError as error:
        return f"gcore left no whole file: {error.strerror}"
    return None
