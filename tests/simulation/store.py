"""The simulated ledger's store: an epoch that only grows, commands, and what its disk and its lock do to a writer.

What it keeps waiting goes on when nothing blocks any more; what it refuses, it refuses at once.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum

from hardcore.model import observations as seen
from hardcore.model.looks import LockHolder
from hardcore.model.verdicts import Diagnosis


class Disk(Enum):
    """How the ledger's file system is; the value is what a write says."""

    WELL = ""
    FULL = "ENOSPC"
    READ_ONLY = "EROFS"
    STALLED = "stalled"


class Rot(Enum):
    """How damaged the ledger is."""

    NONE = "whole"
    DEEP = "damaged where only the proof of all of it looks"
    HEAD = "damaged where every start looks"


#: What a core that can't write says of its store, and what that is called.
REFUSALS = {
    Disk.FULL: (seen.StoreFault.FULL, Diagnosis.DISK_FULL),
    Disk.READ_ONLY: (seen.StoreFault.READ_ONLY, Diagnosis.DISK_READ_ONLY),
}


@dataclass(slots=True)
class Store:
    """The ledger: an epoch that only grows, and each command at most once."""

    epoch: int = 3
    commits: list[tuple[int, int, str]] = field(default_factory=list)
    keys: dict[str, int] = field(default_factory=dict)
    disk: Disk = Disk.WELL
    stalled_ns: int = 0
    holder: LockHolder | None = None
    rot: Rot = Rot.NONE
    lethal: set[int] = field(default_factory=set)  # whoever starts from these events crashes
    parked: set[int] = field(default_factory=set)  # they are left out
    waiting: list[Callable[[], None]] = field(default_factory=list)

    @property
    def kills(self) -> bool:
        """Whether a core that starts from it crashes."""
        return bool(self.lethal - self.parked)

    @property
    def blocked(self) -> bool:
        """Whether a write waits, for nobody knows how long."""
        return self.disk is Disk.STALLED or self.holder is not None

    @property
    def ill(self) -> bool:
        """Whether anything is wrong with it."""
        return self.blocked or self.disk is not Disk.WELL or self.rot is not Rot.NONE

    def befall(self, now_ns: int, disk: Disk, holder: LockHolder | None = None) -> None:
        """Something begins or ends; when nothing blocks any more, what waited goes on."""
        self.disk, self.holder = disk, holder
        self.stalled_ns = now_ns if disk is Disk.STALLED else 0
        if not self.blocked:
            waiting, self.waiting = self.waiting, []
            for work in waiting:
                work()

    def raise_epoch(self, expected: int | None) -> bool:
        """Compare and set."""
        if expected is not None and expected != self.epoch:
            return False
        self.epoch += 1
        return True

    def commit(self, epoch: int, life: int, key: str) -> bool:
        """Write one command, if `epoch` is still the one that may; the caller has looked the key up."""
        if epoch != self.epoch:
            return False
        assert key not in self.keys, f"{key} is written twice"
        self.commits.append((epoch, life, key))
        self.keys[key] = len(self.commits)
        return True
