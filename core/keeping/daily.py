"""The backup of each day: made by itself, in a process of its own, when the newest one is a day old.

Whether one is due is told by the folder alone: what lies there proven, and when it was made. So two cores after one another
make one backup a day and not two, and a day on which everything was off has its backup after the next start. The process is
the one that a person starts by `hardcore backup`; it is polite (the lowest priority), knows nothing of a guard, and is ended
with the core that began it, however that ends. A copy that fails is tried again after an hour and said in the log; that there is none is also
what `hardcore status` and `doctor` say, because who counts on a backup has to hear it from somebody else than the one who
makes it.
"""

import asyncio
import datetime as dt
import logging
import os
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Final

from core.journal.backup import BACKUPS
from core.keeping.shelf import made_at, newest
from core.settings import Settings

AGAIN_AFTER: Final = dt.timedelta(hours=1)
_TAIL_BYTES: Final = 2_000

logger = logging.getLogger("core.keeping")


def is_due(names: Iterable[str], now: dt.datetime, every: dt.timedelta) -> bool:
    """Whether the newest of these backups is older than `every`, or of a time to come (a clock was put back)."""
    name = newest(names)
    made = made_at(name) if name is not None else None
    return made is None or not made <= now + every or now - made >= every


class DailyBackup:
    """The deed. `on_failed` is told one sentence where no backup could be made."""

    def __init__(self, data: Path, settings: Settings, on_failed: Callable[[str], object]) -> None:
        """Prepare; the rest before the first one begins now."""
        self._data = data
        self._settings = settings
        self._on_failed = on_failed
        self._not_before: dt.datetime | None = None

    async def __call__(self, now: dt.datetime) -> None:
        """Make a backup where one is due, and return once it is made, or was not."""
        every = dt.timedelta(hours=self._settings.backup_every_h)
        if self._not_before is None:
            self._not_before = now + dt.timedelta(milliseconds=self._settings.backup_after_ms)
        # A clock that was put back by more than the rest must not hold the next one off for ever.
        held_off = dt.timedelta(0) < self._not_before - now <= max(AGAIN_AFTER, every)
        if not every or held_off or not is_due(await asyncio.to_thread(self._names), now, every):
            return
        failed = await self._make()
        self._not_before = now + AGAIN_AFTER
        if failed is not None:
            logger.error("The backup of the day could not be made: %s", failed)
            self._on_failed(failed)

    def _names(self) -> list[str]:
        with suppress(OSError):
            return os.listdir(self._data / BACKUPS)  # noqa: PTH208  names are all that is asked for
        return []

    async def _make(self) -> str | None:
        """Have it made, and return why it was not."""
        words = (
            "-I",
            "-m",
            "core",
            "backup",
            "--politely",
            "--parent",
            str(os.getpid()),
            "--data",
            str(self._data),
            "--keep",
            str(self._settings.backup_keep),
        )
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            *words,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.PIPE,
            env={name: os.environ[name] for name in ("PATH", "HOME", "TMPDIR", "LANG") if name in os.environ},
        )
        try:
            async with asyncio.timeout(self._settings.backup_ms_max / 1000):
                _, said = await process.communicate()
        except TimeoutError:
            return "it took longer than backup_ms_max"
        finally:
            if process.returncode is None:
                with suppress(ProcessLookupError):
                    process.kill()
        text = said[-_TAIL_BYTES:].decode("utf-8", "replace").strip()
        return None if process.returncode == 0 else (text.splitlines() or ["it ended without a word"])[-1]
