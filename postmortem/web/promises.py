"""What people were told during outages, beside how long they took: the file that the gateway keeps for its estimates.

Read of whatever it holds and no further than it may be long; a row that makes no sense is passed over. The rows carry no
time and no incident, so they stand under the trends and not beside an incident, where one could only be guessed.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

from postmortem.incident import mapping, mappings, number
from postmortem.placing import read_up_to

FILE_BYTES_MAX: Final = 256 << 10
MS_PER_S: Final = 1_000


class Promise(msgspec.Struct, frozen=True):
    """What was told at its narrowest, in whole seconds, and how long it took."""

    low_s: int
    high_s: int
    total_ms: int

    @property
    def within(self) -> bool:
        """Tell whether it was over in the time that was told; sooner breaks no promise."""
        return self.total_ms <= self.high_s * MS_PER_S


def promises(data: Path) -> list[Promise]:
    """Return the promises of the outages on record, the newest first."""
    try:
        with (data / "state" / "recoveries.json").open("rb") as file:
            kept = json.loads(read_up_to(file.fileno(), FILE_BYTES_MAX))
    except (OSError, ValueError, RecursionError):
        return []
    found = (_promise(row) for row in mappings(mapping(kept).get("recoveries")))
    return [one for one in found if one is not None][::-1]


def _promise(row: Mapping[str, Any]) -> Promise | None:
    told, total_ms = row.get("told_s"), number(row.get("total_ms"))
    if (
        not isinstance(told, list)
        or len(told) != len(("low_s", "high_s"))
        or total_ms is None
        or total_ms < 0
    ):
        return None
    low_s, high_s = number(told[0]), number(told[1])
    return (
        None
        if low_s is None or high_s is None or not 0 <= low_s <= high_s
        else Promise(low_s, high_s, total_ms)
    )
