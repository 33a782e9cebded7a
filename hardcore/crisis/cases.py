"""Cases: the whole request of a suspect on the disk, so that it can be tried while nobody holds it any more.

A case is written on a thread, whole and synced, and then the guard is told of it; again with each list of suspects,
because a new guard has heard nothing. What opens doors (cookies, passwords) is never in one: a trial runs without it.
What is too large, or finds no room, is no case, and nobody is told: its suspect is answered when its time is over.
Sending the request over the feed instead was not chosen: a guard that dies would lose what has to outlive everybody.
"""

import asyncio
import base64
import datetime as dt
import logging
import time
from collections.abc import Callable, Collection, Coroutine, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from hardcore.crisis.heads import Header
from hardcore.crisis.mishap import describe
from hardcore.host.files import write_json

_LOG = logging.getLogger(__name__)

#: Bytes of all cases together, and of the body of one.
CASES_BYTES_MAX: Final = 64 << 20
BODY_BYTES_MAX: Final = 1 << 20
#: A case that is older was forgotten by everybody; so often they are looked for.
KEPT_S: Final = 24 * 3600
SWEEP_S: Final = 3600
#: What opens doors.
_SECRET: Final = frozenset({b"authorization", b"cookie", b"proxy-authorization"})


@dataclass(frozen=True, slots=True)
class Draft:
    """A request as it would be filed. `name`: its suspect's; `source`: who sent it; `body`: in its pieces."""

    name: str
    source: str
    key: str | None
    digest: str
    method: str
    target: str
    headers: tuple[tuple[str, str], ...] = field(repr=False)
    body: tuple[bytes, ...] = field(repr=False)
    body_bytes: int = 0

    @property
    def files(self) -> bool:
        """Whether it is small enough to be a case."""
        return self.body_bytes <= BODY_BYTES_MAX


def shown(headers: Sequence[Header]) -> tuple[tuple[str, str], ...]:
    """A request's headers without what opens doors."""
    kept = ((name, value) for name, value in headers if name.lower() not in _SECRET)
    return tuple((name.decode("latin-1"), value.decode("latin-1")) for name, value in kept)


class Cases:
    """The folder of cases. `filed` is called with the name of each that lies there safely."""

    def __init__(
        self, loop: asyncio.AbstractEventLoop, folder: Path | None, filed: Callable[[str], None]
    ) -> None:
        self._loop = loop
        self._folder = folder
        self._filed = filed
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="cases") if folder is not None else None
        self._filed_bytes = (
            0  # of all that lies there; the guard takes away too, so only the thread counts anew
        )
        self._there: set[str] = set()  # whose case lies there
        self._coming: set[str] = set()  # whose case is being written
        self._swept_s = loop.time()
        self._early: set[str] | None = (
            None if folder is None else set()
        )  # suspects named before the folder was read
        self._tasks: set[asyncio.Task[None]] = set()

    def start(self) -> None:
        """See what earlier gateways have left, and let go of what is too old."""
        if self._folder is not None:
            self._soon(self._begin(self._folder))

    async def _begin(self, folder: Path) -> None:
        self._there |= await self._loop.run_in_executor(self._thread, self._sweep, folder)
        early, self._early = self._early or set(), None
        self.tell(early)

    def upkeep(self) -> None:
        """Now and then: let go of what has become too old."""
        if self._folder is not None and self._loop.time() - self._swept_s >= SWEEP_S:
            self._swept_s = self._loop.time()
            self._soon(self._again(self._folder))

    async def _again(self, folder: Path) -> None:
        found = await self._loop.run_in_executor(self._thread, self._sweep, folder)
        self._there &= found | self._coming

    def tell(self, names: Collection[str]) -> None:
        """These are suspects: say which of them have their case, to a guard that may not have heard it."""
        if self._early is not None:
            self._early.update(names)
        for name in names:
            if name in self._there:
                self._filed(name)

    def has(self, name: str) -> bool:
        """Whether a case lies there, or will in a moment."""
        return name in self._there or name in self._coming

    def file(self, draft: Draft) -> None:
        """File a case, if there is room."""
        if self._folder is not None and draft.files and draft.name not in self._coming:
            self._coming.add(draft.name)
            self._soon(self._file(self._folder, draft))

    async def _file(self, folder: Path, draft: Draft) -> None:
        written = await self._loop.run_in_executor(self._thread, self._write, folder, draft)
        self._coming.discard(draft.name)
        if written:
            self._there.add(draft.name)
            self._filed(draft.name)

    def hand_over(self, name: str) -> None:
        """A case is the guard's now, who takes it away once its letter is written."""
        self._there.discard(name)

    def remove(self, name: str) -> None:
        """A case is over."""
        if self._folder is not None:
            self._there.discard(name)
            self._soon(self._remove(self._folder / f"{name}.json"))

    async def _remove(self, path: Path) -> None:
        await self._loop.run_in_executor(self._thread, _removed, path)

    async def finish(self) -> None:
        """Let what is being written be written."""
        await asyncio.gather(*self._tasks, return_exceptions=True)
        if self._thread is not None:
            self._thread.shutdown(wait=False)

    def _soon(self, deed: Coroutine[object, object, None]) -> None:
        task = self._loop.create_task(deed)
        self._tasks.add(task)
        task.add_done_callback(self._over)

    def _over(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            _LOG.error("a case could not be seen to: %s", describe(error))

    # -- on the thread ---------------------------------------------------------------------------------

    def _sweep(self, folder: Path) -> set[str]:
        """Let go of what is too old, and count the rest: who has a case."""
        found = _swept(folder, time.time() - KEPT_S)
        self._filed_bytes = sum(found.values())
        return set(found)

    def _write(self, folder: Path, draft: Draft) -> bool:
        """Write a case, if there is room: whether it lies there."""
        wanted = draft.body_bytes * 2  # as it will lie there, nearly
        if self._filed_bytes + wanted > CASES_BYTES_MAX:
            self._sweep(folder)
        if self._filed_bytes + wanted > CASES_BYTES_MAX:
            _LOG.warning("a case was not written: there are %d bytes of them", self._filed_bytes)
            return False
        size = _written(folder, draft)
        self._filed_bytes += size or 0
        return size is not None


def _swept(folder: Path, oldest_s: float) -> dict[str, int]:
    """What lies there that is not too old, with its size."""
    found: dict[str, int] = {}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path in folder.iterdir():
            with suppress(OSError):
                about = path.lstat()
                if about.st_mtime < oldest_s:
                    path.unlink()
                elif path.suffix == ".json":
                    found[path.stem] = about.st_size
    except OSError as error:
        _LOG.warning("the cases could not be looked through: %s", error.strerror)
    return found


def _written(folder: Path, draft: Draft) -> int | None:
    """The size of the case on the disk; None: it is not there."""
    path = folder / f"{draft.name}.json"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_json(path, _fields(draft))
        return path.stat().st_size
    except OSError as error:
        _LOG.warning("a case could not be written: %s", error.strerror)
        return None


def _removed(path: Path) -> None:
    with suppress(OSError):
        path.unlink(missing_ok=True)


def _fields(draft: Draft) -> dict[str, object]:
    request = {
        "method": draft.method,
        "path": draft.target,
        "headers": [list(pair) for pair in draft.headers],
        "body": base64.b64encode(b"".join(draft.body)).decode(),
    }
    return {
        "version": 1,
        "name": draft.name,
        "at": dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z"),
        "source": draft.source,
        "key": draft.key,
        "digest": draft.digest,
        "case": {"name": draft.name, "request": request},
    }
