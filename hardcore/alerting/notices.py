"""What waits to be sent: the files that the guard has put into its outbox, read without trusting them."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from hardcore.recovery.channels import Occasion, Stage

NOTICE_BYTES_MAX: Final = 64 << 10
#: Of these so many are looked at; the guard leaves no more.
NOTICES_MAX: Final = 256
_CHARACTERS_MAX: Final = 2_000


@dataclass(frozen=True, slots=True)
class Notice:
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
        return Occasion(self.stage, self.fingerprint, self.incident)


def waiting(folders: tuple[Path, ...]) -> list[Path]:
    """Return the files that wait, in the order in which they were put there."""
    found: list[Path] = []
    for folder in folders:
        try:
            found += [path for path in folder.iterdir() if path.suffix == ".json" and path.name[0] != "."]
        except OSError:
            continue  # there is none yet
    return sorted(found, key=lambda path: path.name)[:NOTICES_MAX]


def read_notice(path: Path) -> Notice | None:
    """Return what a file says, or None: it is none of ours."""
    try:
        with path.open("rb") as file:
            value = json.loads(file.read(NOTICE_BYTES_MAX))
    except (OSError, ValueError, RecursionError):
        return None
    return _notice(path.stem, value) if isinstance(value, dict) else None


def _notice(name: str, value: Mapping[str, Any]) -> Notice | None:
    stage, outage_ms = value.get("stage"), value.get("outage_ms")
    if not isinstance(stage, str) or stage not in set(Stage):
        return None
    diagnosis = _text(value, "diagnosis")
    measured = isinstance(outage_ms, int | float) and not isinstance(outage_ms, bool)
    return Notice(
        name,
        _text(value, "at"),
        Stage(stage),
        diagnosis,
        _text(value, "fingerprint") or diagnosis,
        _text(value, "incident") or None,
        _text(value, "text"),
        _text(value, "outcome"),
        float(outage_ms) if measured and outage_ms is not None else None,
        _text(value, "url"),
    )


def _text(value: Mapping[str, Any], name: str) -> str:
    said = value.get(name)
    return said[:_CHARACTERS_MAX] if isinstance(said, str) else ""
