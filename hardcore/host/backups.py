"""The folder of backups, seen from outside: which is the newest that was proven, and how many there are.

The ledger's side makes them and gives them their names (`docs/wires.md`, at `python -m core backup`); a file beside each says that it was
proven. The guard only lists names: a person who counts on backups has to hear of a missing one from somebody else than the one
who makes them.
"""

import datetime as dt
import re
from pathlib import Path

import msgspec

FOLDER = "backups"
_NAMED = re.compile(r"ledger-(\d{8}T\d{6}Z)-seq(\d+)\.db")
_NOTED = ".json"


class Kept(msgspec.Struct, frozen=True):
    """What lies there: the newest proven one and when it was made (RFC 3339), both None without one; and how many."""

    name: str | None = None
    made_at: str | None = None
    count: int = 0


def kept_in(data: Path) -> Kept:
    """Look at a data folder. A folder that can't be listed has none."""
    try:
        names = {path.name for path in (data / FOLDER).iterdir()}
    except OSError:
        return Kept()
    proven = sorted(name for name in names if _NAMED.fullmatch(name) and name + _NOTED in names)
    if not proven:
        return Kept()
    made = _made(proven[-1])
    return Kept(proven[-1], None if made is None else made.isoformat().replace("+00:00", "Z"), len(proven))


def age_s(kept: Kept, now_s: float) -> float | None:
    """Return how old the newest one is at this wall time, in seconds; None where nobody knows."""
    made = _made(kept.name) if kept.name is not None else None
    return None if made is None else now_s - made.timestamp()


def _made(name: str) -> dt.datetime | None:
    named = _NAMED.fullmatch(name)
    if named is None:
        return None
    try:
        return dt.datetime.strptime(named[1], "%Y%m%dT%H%M%SZ").replace(tzinfo=dt.UTC)
    except ValueError:
        return None
