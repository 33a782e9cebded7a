"""The data folder's file system: how much room, whether it may be written, and what our own small write takes.

The core's word that its disk fails is one kind of evidence, our own write with its fsync on the same file system
is the other. It is a new file each time, because writing over a block that is there succeeds on a full disk. All
of it runs as an errand: a dead network disk stops whoever asks it anything, and that it hangs is the finding.
"""

import errno
import os
import sys
import time
from pathlib import Path

import msgspec
from msgspec import structs

from hardcore.host.errand import Errand
from hardcore.model.looks import DiskFacts

PROBE_NAME = ".disk-probe"
PROBE_BYTES = 4096
#: A disk that is well is written to this often at most: each time costs it an fsync.
WRITE_EVERY_NS = 5_000_000_000
#: A write slower than this is looked at again at the next survey.
SLOW_NS = 500_000_000
#: A survey waits so long for the answer; after that it tells for how long it is pending.
PATIENCE_S = 0.2


class _Look(msgspec.Struct, frozen=True):
    """One look. `write_ns` None: nothing was written this time. Where nobody tells the room, it is endless."""

    at_ns: int
    free_bytes: int
    read_only: bool
    write_ns: int | None
    fault: str
    size_bytes: int = 0


class DiskWatch:
    """Looks at the file system of `data`, writing in `folder` below it. Used from one thread."""

    def __init__(self, data: Path, folder: Path) -> None:
        self._data = data
        self._probe = folder / PROBE_NAME
        self._errand = Errand("disk", self._look)
        self._wrote_ns: int | None = None
        self._write = False
        self._reserve_is_ours = has_reserve()
        self._facts = DiskFacts(free_bytes=0, read_only=False, write_ns=None)

    def look(self, now_ns: int, *, now: bool = False) -> DiskFacts | None:
        """Return what is known of the disk. `now`: write to it though it was well a moment ago.

        None: nothing is known yet, because its first answer has not come.
        """
        if self._errand.back(0):
            self._write = now or self._is_due(now_ns)
            self._errand.send(now_ns)
        self._errand.back(PATIENCE_S)
        if self._errand.last is not None:
            self._facts = self._taken(self._errand.last)
        pending_ns = self._errand.pending_ns(time.monotonic_ns())
        if pending_ns:
            facts = self._facts
            return structs.replace(facts, write_ns=None, pending_ns=pending_ns)
        return self._facts if self._errand.last is not None else None

    def _is_due(self, now_ns: int) -> bool:
        facts = self._facts
        well = not facts.fault and not facts.read_only and (facts.write_ns or 0) < SLOW_NS
        return not well or self._wrote_ns is None or now_ns - self._wrote_ns >= WRITE_EVERY_NS

    def _taken(self, look: _Look) -> DiskFacts:
        """Return the newest facts: what the last write said stands until the next one."""
        if look.write_ns is None:
            fault = look.fault or self._facts.fault
            write_ns = self._facts.write_ns
            return DiskFacts(look.free_bytes, look.read_only, write_ns, 0, fault, look.size_bytes)
        self._wrote_ns = look.at_ns
        return DiskFacts(look.free_bytes, look.read_only, look.write_ns, 0, look.fault, look.size_bytes)

    def _look(self) -> _Look:
        at_ns = time.monotonic_ns()
        try:
            about = os.statvfs(self._data)
        except OSError as error:
            return _Look(at_ns, 0, read_only=False, write_ns=0, fault=_named(error))
        told_bytes = told_free_bytes(about, reserve_is_ours=self._reserve_is_ours)
        free_bytes = sys.maxsize if told_bytes is None else told_bytes
        read_only = bool(about.f_flag & os.ST_RDONLY)
        size_bytes = about.f_blocks * about.f_frsize
        if not self._write:
            return _Look(at_ns, free_bytes, read_only, None, "", size_bytes)
        began_ns = time.monotonic_ns()
        fault = write_once(self._probe)
        return _Look(at_ns, free_bytes, read_only, time.monotonic_ns() - began_ns, fault, size_bytes)


def told_free_bytes(about: os.statvfs_result, *, reserve_is_ours: bool) -> int | None:
    """Return how much may be written, by the core's own rule; None where the file system does not tell its size.

    `reserve_is_ours`: what is kept back for the superuser is room too.
    """
    if about.f_blocks == 0:
        return None
    return (about.f_bfree if reserve_is_ours else about.f_bavail) * about.f_frsize


def has_reserve() -> bool:
    """Whether this process may write where room is kept back for the superuser.

    The root of a container with users of its own is another one, and none such room is his.
    """
    try:
        mapped = Path("/proc/self/uid_map").read_text().split()
    except OSError:
        return False
    return os.geteuid() == 0 and mapped[:2] == ["0", "0"]


def write_once(path: Path) -> str:
    """Write a small new file, have it on the disk, and remove it; return the error's name, empty if all went well."""
    try:
        path.unlink(missing_ok=True)  # a writer that died in the middle has left it
        fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        try:
            if os.write(fd, bytes(PROBE_BYTES)) < PROBE_BYTES:
                return "ENOSPC"
            os.fsync(fd)
        finally:
            path.unlink(missing_ok=True)
            os.close(fd)
    except OSError as error:
        return _named(error)
    return ""


def _named(error: OSError) -> str:
    return errno.errorcode.get(error.errno or 0, "EIO")
