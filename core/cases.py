"""Cases: what the core itself wished for and held when one of its lives died, filed for the court that tries it.

A request of a browser is held by the gateway, which files it. What has no sender but this core (a row of an import, an errand
of the scheduler) is filed here in the same shape (`docs/wires.md` section 14): written whole or not at all, and again by the
next life if this one dies.
"""

import datetime as dt
import json
import os
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Final

import msgspec

VERSION: Final = 1
UNFINISHED: Final = ".new"


class Case(msgspec.Struct, frozen=True):
    """What is to be tried under this name, from whom it comes, and the key under which it would be done.

    `tried`: the member that says how it is tried again (`request` or `row`), with its value.
    """

    name: str
    key: str
    source: str
    tried: Mapping[str, object]


def file_cases(folder: Path, cases: Sequence[Case]) -> None:
    """File all of them, those that lie there already excepted. Blocks; raises OSError."""
    for one in cases:
        path = folder / f"{one.name}.json"
        if not path.exists():
            _write(path, json.dumps(_told(one)).encode())
    _flush(folder)


def _told(one: Case) -> dict[str, object]:
    return {
        "version": VERSION,
        "name": one.name,
        "at": dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z"),
        "source": one.source,
        "key": one.key,
        "digest": sha256(one.key.encode()).hexdigest(),
        "case": {"name": one.name, **one.tried},
    }


def _write(path: Path, content: bytes) -> None:
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    fresh = path.with_name(path.name + UNFINISHED)
    with fresh.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    fresh.rename(path)


def _flush(folder: Path) -> None:
    fd = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
