"""The gateway's own recorder page: its layout, its making, and its reading while the gateway lives or is dead.

Words of 8 bytes in the machine's order, each stored and read on its own (`docs/wires.md` section 18); a word can't be
torn, and nothing on this page has to agree with anything else on it, so there is no lock. It is read with `pread` on
a descriptor that is kept, never mapped: a page that somebody cut short must not end the guard that reads it. Giving
the gateway a page of the core's form was not chosen: of that, four fifths would have stayed empty.
"""

import os
import stat
import struct
from contextlib import suppress
from pathlib import Path

from hardcore.model.gateway import GatewayPage, GatewayPulse, GatewayRequest, Stage

MAGIC = b"HCGATE01"
SLOTS = 256
SLOT_BYTES = 64
SLOTS_AT = 4096
FILE_BYTES = SLOTS_AT + SLOTS * SLOT_BYTES

#: Places of words, counted in words from the page's begin.
PID, START, LOOP_THREAD, BEAT_THREAD = 4, 5, 6, 7
LOOP_NS, LOOP_COUNT, THREAD_NS = 8, 9, 10
BEGUN, OVER, OVERDUE, OVERDUE_NS, REFUSED, GC_SINCE_NS = 11, 12, 13, 14, 15, 16
#: Of a slot, from its own begin.
STAGE, SINCE_NS, PATH_HASH, BYTES_READ, CONNECTION = range(5)
FIRST_SLOT, SLOT_WORDS = SLOTS_AT // 8, SLOT_BYTES // 8

_MADE = struct.Struct("=8s3Q")
_PULSE = struct.Struct("=13Q")
_PULSE_AT = 32
_HEAD_BYTES = _PULSE_AT + _PULSE.size
_SLOT = struct.Struct("=2Q8s2Q")
_UNKNOWN = bytes(8)


def last_of(path: Path) -> Path:
    """Return where the page of the gateway before this one is kept."""
    return path.with_name(f"{path.name}.last")


def make_page(path: Path) -> None:
    """Put a new page at `path`, the one that was there beside it. Raises OSError when there is no room for it."""
    made = path.with_name(f".{path.name}.new")
    made.unlink(missing_ok=True)
    fd = os.open(made, os.O_CREAT | os.O_EXCL | os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    try:
        # Allocated, not only sized: a store into a hole on a full file system would be a SIGBUS.
        os.posix_fallocate(fd, 0, FILE_BYTES)
        os.pwrite(fd, _MADE.pack(MAGIC, FILE_BYTES, SLOTS, SLOT_BYTES), 0)
    except BaseException:
        made.unlink(missing_ok=True)
        raise
    finally:
        os.close(fd)
    set_aside(path)
    made.replace(path)


def set_aside(path: Path) -> None:
    """Keep the page at `path`, if there is one, as that of the gateway before: its loss is told once."""
    with suppress(FileNotFoundError):
        path.replace(last_of(path))


class GatewayPageReader:
    """Reads one page. No method raises, whatever is done to the file or written in it."""

    def __init__(self, path: Path) -> None:
        self._fd = _opened(path)

    def raw(self) -> bytes:
        """Return the page's bytes; fewer than FILE_BYTES where it is no evidence."""
        if self._fd is None:
            return b""
        try:
            return os.pread(self._fd, FILE_BYTES, 0)
        except OSError:
            return b""

    def pulse(self, pid: int, start: int) -> GatewayPulse | None:
        """Return the head of the page; None while that process has not written it, or it is no evidence."""
        if self._fd is None:
            return None
        try:
            head = os.pread(self._fd, _HEAD_BYTES, 0)
        except OSError:
            return None
        pulse = _pulse(head)
        return pulse if pulse is not None and (pulse.pid, pulse.start) == (pid, start) else None

    def close(self) -> None:
        """Give the descriptor back."""
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None


def _opened(path: Path) -> int | None:
    try:
        # Non-blocking, or somebody's FIFO in the page's place would stop the watch for ever.
        fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return None
    if not stat.S_ISREG(os.fstat(fd).st_mode):
        os.close(fd)
        return None
    return fd


def _pulse(head: bytes) -> GatewayPulse | None:
    made = _MADE.pack(MAGIC, FILE_BYTES, SLOTS, SLOT_BYTES)
    if len(head) < _HEAD_BYTES or head[: len(made)] != made:
        return None
    return GatewayPulse(*_PULSE.unpack_from(head, _PULSE_AT))


def decode(raw: bytes) -> GatewayPage | None:
    """Return the whole page in `raw`, or None when it is not a page of this version."""
    pulse = _pulse(raw)
    if pulse is None or len(raw) != FILE_BYTES:
        return None
    slots = (_SLOT.unpack_from(raw, at) for at in range(SLOTS_AT, FILE_BYTES, SLOT_BYTES))
    used = [slot for slot in slots if 0 < slot[0] <= max(Stage)]
    return GatewayPage(
        pulse,
        tuple(
            GatewayRequest(Stage(stage), since_ns, "" if name == _UNKNOWN else name.hex(), size, connection)
            for stage, since_ns, name, size, connection in used
        ),
    )
