"""What kept copies are called, and which of them may go.

Pure: it is given names and never looks. A name says when a copy was made and how far it goes, so a person who has nothing
but a folder can choose; what else is known of one stands in a small file beside it, which is written only after the copy was
proven. So a copy without that file is none: it is what a death or a full disk has left. Only what carries such a name is ever
removed, and never the newest.
"""

import datetime as dt
import re
from collections.abc import Iterable
from typing import Final

import msgspec

SUFFIX: Final = ".json"  # of the file beside a copy
_NAMED: Final = re.compile(r"ledger-(\d{8}T\d{6}Z)-seq(\d+)\.db")
_TIME: Final = "%Y%m%dT%H%M%SZ"


class Note(msgspec.Struct, frozen=True):
    """What is known of a copy: its last event, the book it holds, and its bytes. `rules`: the guard's, if there are any.

    `proven_at` is RFC 3339 in UTC. `schema` is the version of its tables.
    """

    file: str
    proven_at: str
    events: int
    head: str
    epoch: int
    schema: int
    size_bytes: int
    sha256: str
    trial_balance: dict[str, str]
    rules: str | None = None


def name_of(made_at: dt.datetime, seq: int) -> str:
    """Return what a copy is called that was made at this moment and ends with this event."""
    return f"ledger-{made_at.astimezone(dt.UTC).strftime(_TIME)}-seq{seq}.db"


def made_at(name: str) -> dt.datetime | None:
    """Return when a copy of this name was made; None: it is none of ours."""
    named = _NAMED.fullmatch(name)
    if named is None:
        return None
    try:
        return dt.datetime.strptime(named[1], _TIME).replace(tzinfo=dt.UTC)
    except ValueError:
        return None


def newest(names: Iterable[str]) -> str | None:
    """Return the newest copy among the names of a folder, one that was proven; None without one."""
    there = set(names)
    return max((name for name in there if _is_copy(name, there)), key=_age, default=None)


def superfluous(names: Iterable[str], keep: int) -> list[str]:
    """Return the copies that go when `keep` (at least one) are kept, the oldest first; what was not proven stays."""
    assert keep >= 1
    there = set(names)
    kept = sorted((name for name in there if _is_copy(name, there)), key=_age)
    return kept[:-keep]


def _is_copy(name: str, there: set[str]) -> bool:
    return made_at(name) is not None and name + SUFFIX in there


def _age(name: str) -> tuple[str, int]:
    named = _NAMED.fullmatch(name)
    assert named is not None, "only copies are sorted"
    return named[1], int(named[2])
