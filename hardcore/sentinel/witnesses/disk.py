"""The witness of the disk: is there room, may one write, does a small write of our own come back?

We write ourselves, with fsync, off the loop: a core that waits in the store and a write of ours that does not come
back are two kinds of evidence for one standing disk. Only what was measured counts: between two surveys nobody knows
whether the write has come back. That there is no room, or that nothing may be written, must be found by two surveys in
a row, so that a file that came and went is no full disk.
"""

import msgspec

from hardcore.model.looks import DiskFacts
from hardcore.model.observations import Surveyed
from hardcore.model.verdicts import Colour, Diagnosis, Testimony
from hardcore.sentinel.lasting import NS_PER_MS
from hardcore.sentinel.seen_time import SeenTime

#: A survey older than this says nothing about now, unless they are to be made more rarely than that.
STALE_NS = 15_000_000_000
#: So many surveys must have been left out.
STALE_SURVEYS = 3
_FULL = frozenset({"ENOSPC", "EDQUOT"})
#: EIO too: a disk that fails what we write takes no writes, whatever it is called.
_READ_ONLY = frozenset({"EROFS", "EIO"})


class DiskFindings(msgspec.Struct, frozen=True):
    """Since when each thing has been so (monotonic ns), 0: it is not.

    `slow_ns`: how long our write took, or had taken when it was last looked at, as far as we were there.
    """

    full_since_ns: int = 0
    read_only_since_ns: int = 0
    slow_since_ns: int = 0
    free_bytes: int = 0
    slow_ns: int = 0
    fault: str = ""


class Disk(msgspec.Struct):
    """Remembers the last survey, and since when it has found what it finds. The limits are the policy's."""

    floor_bytes: int
    slow_ms: int
    survey_ms: int
    _last: DiskFacts | None = None
    _at_ns: int = 0
    _full_ns: int = 0
    _read_only_ns: int = 0
    _full_twice: bool = False
    _read_only_twice: bool = False

    def adopt(self, floor_bytes: int, slow_ms: int, survey_ms: int) -> None:
        """Go by other limits from now on."""
        self.floor_bytes, self.slow_ms, self.survey_ms = floor_bytes, slow_ms, survey_ms

    def hear(self, fact: Surveyed) -> None:
        """Take in a survey, if it looked at the disk."""
        if fact.disk is None:
            return
        self._last, self._at_ns = fact.disk, fact.at_ns
        full = fact.disk.fault in _FULL or fact.disk.free_bytes < self.floor_bytes
        read_only = fact.disk.read_only or fact.disk.fault in _READ_ONLY
        self._full_twice, self._full_ns = _again(self._full_ns, fact.at_ns, holds=full and not read_only)
        self._read_only_twice, self._read_only_ns = _again(self._read_only_ns, fact.at_ns, holds=read_only)

    def find(self, seen: SeenTime) -> DiskFindings:
        """Return what the surveys have found so far."""
        disk, age_ns = self._last, seen.at_ns - self._at_ns
        if disk is None or age_ns > max(STALE_NS, STALE_SURVEYS * self.survey_ms * NS_PER_MS):
            return DiskFindings()
        took_ns = disk.pending_ns if disk.write_ns is None else disk.write_ns
        slow_ns = seen.between(self._at_ns - took_ns, self._at_ns)
        slow = slow_ns >= self.slow_ms * NS_PER_MS and age_ns <= STALE_NS
        return DiskFindings(
            full_since_ns=self._full_ns if self._full_twice else 0,
            read_only_since_ns=self._read_only_ns if self._read_only_twice else 0,
            slow_since_ns=max(1, self._at_ns - took_ns) if slow else 0,
            free_bytes=disk.free_bytes,
            slow_ns=slow_ns,
            fault=disk.fault,
        )


def _again(since_ns: int, at_ns: int, *, holds: bool) -> tuple[bool, int]:
    """Return whether it was so before as well, and since when it has been."""
    return (holds and bool(since_ns), (since_ns or at_ns) if holds else 0)


def refusal(disk: DiskFacts | None) -> Diagnosis | None:
    """Return what a disk is called that refuses a write of ours; None: it takes them, or nobody has looked."""
    if disk is None:
        return None
    if disk.read_only or disk.fault in _READ_ONLY:
        return Diagnosis.DISK_READ_ONLY
    return Diagnosis.DISK_FULL if disk.fault in _FULL else None


def testify(found: DiskFindings) -> Testimony | None:
    """Return what is wrong with the disk, or None. Never red: what it does to the core is another's to say."""
    said = []
    if found.read_only_since_ns:
        said.append("the data folder's file system takes no writes")
    if found.full_since_ns:
        said.append(f"{found.free_bytes >> 20} MiB are free" + (f" ({found.fault})" if found.fault else ""))
    if found.slow_since_ns:
        said.append(f"a small write of ours has taken {found.slow_ns // NS_PER_MS} ms")
    return Testimony("disk", Colour.YELLOW, "; ".join(said)) if said else None
