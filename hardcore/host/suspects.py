"""What the guard remembers of suspects, on the disk: the pure value of the court with a wall time beside each name.

A successor goes on with it: an open suspect is tried again, a verdict is said again. What was settled more than a day
ago is left out when it is read, because a command that has done nothing for a day is nobody's suspect. Monotonic times
were not chosen: they mean nothing after the machine has been off.
"""

import datetime as dt
from collections.abc import Mapping
from typing import Any, Final

from msgspec import structs

from hardcore.host import files
from hardcore.host.folders import Folders
from hardcore.model.codec import Codec
from hardcore.model.trials import Conviction, CourtMemory, Ordeal, Suspect
from hardcore.model.verdicts import Diagnosis

VERSION: Final = 1
KEPT: Final = dt.timedelta(days=1)

FILE_BYTES_MAX: Final = 8 << 20

_MEMBERS = {cls: frozenset(cls.__struct_fields__) for cls in (CourtMemory, Suspect)}
_CODEC = Codec((CourtMemory, Suspect, Conviction, Ordeal, Diagnosis))


def write(folders: Folders, memory: CourtMemory, at: Mapping[str, str], *, durable: bool) -> None:
    """Put the court's memory on the disk. `at`: since when each suspect is as it stands, RFC 3339. Raises OSError."""
    told = {"version": VERSION, "at": dict(at), "memory": _CODEC.encode(memory)}
    files.write_json(folders.suspects, told, durable=durable)


def read(folders: Folders, now: dt.datetime) -> tuple[CourtMemory, dict[str, str]]:
    """Return what an earlier guard remembered, and since when; nothing where that can't be read."""
    told = files.read_json(folders.suspects, FILE_BYTES_MAX)
    memory, at = _CODEC.decode(_known(told.get("memory"))), told.get("at")
    if told.get("version") != VERSION or not isinstance(memory, CourtMemory) or not isinstance(at, dict):
        return CourtMemory(), {}
    kept = tuple(one for one in memory.suspects if one.ordeal is None or _young(at.get(one.name), now))
    return structs.replace(memory, suspects=kept), {
        one.name: str(at.get(one.name) or _written(now)) for one in kept
    }


def _known(memory: Any) -> Any:
    """Return the memory without what only another version of this guard knows: no suspect is forgotten for that."""
    match memory:
        case {"CourtMemory": dict() as body}:
            kept = {name: value for name, value in body.items() if name in _MEMBERS[CourtMemory]}
            suspects = kept.get("suspects")
            if isinstance(suspects, list):
                kept["suspects"] = [_known_of(one) for one in suspects]
            return {"CourtMemory": kept}
        case _:
            return memory


def _known_of(suspect: Any) -> Any:
    match suspect:
        case {"Suspect": dict() as body}:
            return {"Suspect": {name: value for name, value in body.items() if name in _MEMBERS[Suspect]}}
        case _:
            return suspect


def times(before: Mapping[str, str], old: CourtMemory, new: CourtMemory, now: dt.datetime) -> dict[str, str]:
    """Return since when each suspect is as it stands now: its old time, if nothing of it has changed."""
    known = {one.name: one for one in old.suspects}
    return {
        one.name: before[one.name] if known.get(one.name) == one and one.name in before else _written(now)
        for one in new.suspects
    }


def _written(now: dt.datetime) -> str:
    return now.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _young(at: object, now: dt.datetime) -> bool:
    try:
        age = now - dt.datetime.fromisoformat(str(at))
    except (ValueError, TypeError):
        return False
    return age <= KEPT
