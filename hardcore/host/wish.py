"""What the operator wants, as it lies on the disk: one reader, which judges a file that somebody has damaged.

Nobody has said anything: UP. Something was said and can't be read any more: the copy in the run folder says what it was,
and where that is gone too (a reboot), reads only are served, because a wish for that must never be lost in silence; the
reason says so. We write it whole or not at all, so it takes a failing disk or another program to get there.
"""

from pathlib import Path

import msgspec

from hardcore.host import files
from hardcore.host.folders import Folders
from hardcore.model.phases import Wanted

#: Said as the reason where the wish can't be read and nobody remembers it.
UNREADABLE = "what was wanted can't be read (state/wanted.json): `hardcore safe-mode off` says it anew"


class Wish(msgspec.Struct, frozen=True):
    """What is wanted. `before`: SAFE, where DOWN was said over a wish for reads only; `reason`: why reads only."""

    wanted: Wanted = Wanted.UP
    before: Wanted | None = None
    reason: str = ""

    @property
    def safe(self) -> bool:
        """Whether reads only are wanted, now or when it is started again."""
        return Wanted.SAFE in {self.wanted, self.before}


def read(folders: Folders) -> Wish:
    """Return what the operator wants. Never raises."""
    path = folders.state / "wanted.json"
    for place in (path, folders.run / "wanted.json"):
        found = _read(place)
        if found is not None:
            return found
        if place is path and not _is_there(path):
            return Wish()
    return Wish(Wanted.SAFE, reason=UNREADABLE)


def store(folders: Folders, told: dict[str, object]) -> None:
    """Write it down, on the disk first. Raises OSError where that can't be written."""
    files.write_json(folders.state / "wanted.json", told)
    try:
        files.write_json(folders.run / "wanted.json", told, durable=False)
    except OSError:  # nothing runs, or memory is full: the disk has it
        return


def _read(path: Path) -> Wish | None:
    kept = files.read_json(path)
    wanted, before, reason = kept.get("wanted"), kept.get("before"), kept.get("reason")
    if not isinstance(wanted, str) or wanted not in set(Wanted):
        return None
    safe = Wanted.SAFE if before == Wanted.SAFE.value and isinstance(before, str) else None
    return Wish(Wanted(wanted), safe, reason if isinstance(reason, str) else "")


def _is_there(path: Path) -> bool:
    try:
        path.lstat()
    except FileNotFoundError:
        return False
    except OSError:
        return True
    return True
