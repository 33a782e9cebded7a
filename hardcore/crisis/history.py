"""The outages that are over, remembered over the gateway's own deaths, so that the next can be told a time.

Read once, at the start; written by a thread after each outage, whole or not at all. What cannot be read or
written costs an estimate and nothing else.
"""

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from hardcore.crisis.estimate import STAGES, Sample, Told, Way, score, youngest
from hardcore.host.files import read_json, write_json

if TYPE_CHECKING:  # the status command reads the file too, and is spared the 20 ms of a loop
    import asyncio

_LOG = logging.getLogger(__name__)
#: Milliseconds; a longer outage is none that the next could be like.
_LENGTH_MS_MAX = 7 * 24 * 3_600_000


class History:
    """The last outages, the oldest first. Without a path they are forgotten with the gateway."""

    def __init__(self, loop: "asyncio.AbstractEventLoop", path: Path | None) -> None:
        self.samples: tuple[Sample, ...] = read_samples(read_json(path)) if path is not None else ()
        self._loop = loop
        self._path = path
        self._writing: asyncio.Task[None] | None = None
        self._due = False

    def add(self, sample: Sample) -> None:
        """Remember one more."""
        self.samples = youngest((*self.samples, sample))
        self._due = self._path is not None
        if self._due and self._writing is None:
            self._writing = self._loop.create_task(self._write())

    async def _write(self) -> None:
        assert self._path is not None, "what is not kept is not written"
        while self._due:
            self._due = False
            try:
                await self._loop.run_in_executor(None, write_json, self._path, _told(self.samples))
            except OSError as error:
                _LOG.warning("the outages that are over could not be written: %s", error.strerror)
        self._writing = None

    async def finish(self) -> None:
        """Wait until what is known is written."""
        if self._writing is not None:
            await self._writing


def _told(samples: tuple[Sample, ...]) -> dict[str, object]:
    return {"recoveries": [_row(one) for one in samples]}


def _row(one: Sample) -> dict[str, object]:
    told = None if one.told is None else [one.told.low_s, one.told.high_s]
    return {"total_ms": one.total_ms, "reached_ms": list(one.reached_ms), "way": one.way, "told_s": told}


def estimate_score(kept: Mapping[str, object]) -> dict[str, int]:
    """How the estimates came true, out of a file's object: as `hardcore status --json` says it."""
    found = score(read_samples(kept))
    return {"samples": found.samples, "scored": found.scored, "within": found.within}


def read_samples(kept: Mapping[str, object]) -> tuple[Sample, ...]:
    """The samples in a file's object; what makes no sense is passed over."""
    rows = kept.get("recoveries")
    found = [_sample(row) for row in rows] if isinstance(rows, list) else []
    return youngest([one for one in found if one is not None])


def _sample(row: object) -> Sample | None:
    """A row; one of an earlier version says neither way (there was one then) nor promise."""
    if not isinstance(row, dict):
        return None
    total_ms, reached_ms, way = row.get("total_ms"), row.get("reached_ms"), row.get("way", Way.COLD)
    if not _is_length(total_ms) or not isinstance(reached_ms, list) or len(reached_ms) != STAGES:
        return None
    numbers = [0, *reached_ms, total_ms]
    if (
        not all(map(_is_length, reached_ms))
        or numbers != sorted(numbers)
        or not isinstance(way, str)
        or way not in set(Way)
    ):
        return None
    reached = (reached_ms[0], reached_ms[1], reached_ms[2], reached_ms[3])
    return Sample(int(str(total_ms)), reached, Way(way), _promise(row.get("told_s")))


def _promise(row: object) -> Told | None:
    if not isinstance(row, list) or len(row) != len(("low_s", "high_s")) or not all(map(_is_length, row)):
        return None
    return Told(row[0], row[1]) if row[0] <= row[1] else None


def _is_length(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= _LENGTH_MS_MAX
