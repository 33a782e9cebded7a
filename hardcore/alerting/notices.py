"""What waits to be sent: the files that the guard has put into its outbox, read without trusting them."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

from hardcore.alerting.as_read import bounded_number, said
from hardcore.host import files
from hardcore.recovery.channels import Occasion, Stage

NOTICE_BYTES_MAX: Final = 64 << 10
#: Of these so many are looked at; the guard leaves no more.
NOTICES_MAX: Final = 256


class Notice(msgspec.Struct, frozen=True):
    """One thing to be told. `id` names it, also to who receives it twice; `at` is RFC 3339."""

    id: str
    at: str
    stage: Stage
    diagnosis: str
    fingerprint: str
    incident: str | None = None
    text: str = ""
    outcome: str = ""
    outage_ms: float | None = None
    url: str = ""

    @property
    def occasion(self) -> Occasion:
        """What the manners care about."""
        return Occasion(self.stage, self.fingerprint, self.incident, self.outcome)


def waiting(folders: tuple[Path, ...]) -> list[Path]:
    """Return the files that wait, in the order in which they were put there."""
    found: list[Path] = []
    for folder in folders:
        try:
            with os.scandir(folder) as there:
                found += [Path(one.path) for one in there if one.is_file(follow_symlinks=False)]
        except OSError:
            continue  # there is none yet
    ours = [path for path in found if path.suffix == ".json" and path.name[0] != "."]
    return sorted(ours, key=lambda path: path.name)[:NOTICES_MAX]


def read_notice(path: Path) -> Notice | None:
    """Return what a file says, or None: it is none of ours."""
    return _notice(said(path.stem), files.read_json(path, NOTICE_BYTES_MAX))


def _notice(name: str, value: Mapping[str, Any]) -> Notice | None:
    stage = value.get("stage")
    if not isinstance(stage, str) or stage not in set(Stage):
        return None
    diagnosis = _text(value, "diagnosis")
    return Notice(
        name,
        _text(value, "at"),
        Stage(stage),
        diagnosis,
        _text(value, "fingerprint") or diagnosis,
        _text(value, "incident") or None,
        _text(value, "text"),
        _text(value, "outcome"),
        bounded_number(value.get("outage_ms")),
        _text(value, "url"),
    )


def _text(value: Mapping[str, Any], name: str) -> str:
    return said(value.get(name))
