"""The desk: what a person may do with an import (give a file, look at it, choose, commit) and what comes of it.

It knows the folder and who may change what in which state; it knows no protocol and no language. A wish to
commit is on the disk before it is answered, and only the importer acts on it, now or in the next life.
"""

import asyncio
import hashlib
import logging
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Final
from uuid import UUID

import msgspec

from core.guarded.recorder import FlightRecorder
from core.imports.folder import ImportFolder, Imports, is_import_id
from core.imports.importer import KEPT_FILE_LOST, Importer
from core.imports.jobs import ONE_BY_ONE_ROWS, Job, broken
from core.imports.looking import Choices, Looked, Looker, results
from core.imports.outcomes import FAILED_INSIDE
from core.imports.reading.kept import ReadTable, open_table
from core.imports.reading.mapping import faults_of
from core.imports.reading.table import Unreadable
from core.imports.records import Manifest, Progress, Survey
from core.imports.states import State, Trigger, Waiting, after
from core.imports.suspected import Suspected
from core.imports.troubles import Trouble, reading_only, unreadable
from core.service import Service

UPLOADS_MAX: Final = 8
LISTED_MAX: Final = 20
NAME_CHARACTERS_MAX: Final = 255
DAY_NS: Final = 86_400 * 1_000_000_000

logger = logging.getLogger("core.imports")


class Kept(msgspec.Struct, frozen=True):
    """An import as it stands. `table` is None where its rows are lost; `replayed`: its key had made it before.

    `waiting`: why it is not being gone on with at this moment, if it is being booked.
    """

    manifest: Manifest
    table: ReadTable | None
    survey: Survey
    progress: Progress
    replayed: bool = False
    waiting: Waiting | None = None


class Desk:
    """All imports of one core. All methods on the loop's thread."""

    def __init__(
        self, service: Service, recorder: FlightRecorder, data: Path, suspected: Suspected | None = None
    ) -> None:
        """Prepare; the disk is not touched before `start`. `suspected`: rows that wait; absent: none does."""
        self._service = service
        self._recorder = recorder
        self._imports = Imports(data)
        self._looker = Looker(service, data)
        self._importer = Importer(service, recorder, suspected)
        self._uploads: set[str] = set()
        self._changing = asyncio.Lock()  # a wish is looked at and replaced in one go
        self._settled = asyncio.Event()
        self._resting = False
        self._at_work = 0
        self._idle = asyncio.Event()
        self._idle.set()

    async def start(self) -> None:
        """Clear up, go on with what a death has interrupted, and work from now on.

        A core that writes calls it as soon as it serves. Whoever wants to change something meanwhile waits: what
        is cleared away must not be what somebody has just begun. What the disk does not let it do is left.
        """
        self._begin_work()
        try:
            await self._take_up()
        # A disk that fails under old files, or a mistake of ours: the ledger is none of their business.
        except Exception:
            logger.exception("What earlier lives left of imports could not be taken up")
            self._recorder.event("IMPORTS_NOT_TAKEN_UP", "")
        finally:
            if not self._resting:
                self._importer.start()
            self._settled.set()
            self._end_work()

    async def stop(self) -> None:
        """End between two rows, and once all is cleared up. For whoever has called `start`."""
        self._resting = True
        await self._importer.stop()
        await self._settled.wait()

    async def rest(self) -> None:
        """Take nothing new; return once all that was begun is over, between two rows of a running import."""
        self._resting = True
        await self._importer.stop()
        await self._idle.wait()

    @property
    def importer(self) -> Importer:
        """The component that books rows."""
        return self._importer

    def go_on(self) -> None:
        """Work again after `rest`, also where that has not come to its end."""
        self._resting = False
        self._importer.start()

    async def _take_up(self) -> None:
        await asyncio.to_thread(self._imports.clear_unfinished)
        await self._tidy()
        found = await asyncio.to_thread(self._imports.newest_first)
        interrupted = [one for one in found if one.state is State.COMMITTING]
        for manifest in reversed(interrupted):
            await self._go_on(manifest)

    @asynccontextmanager
    async def _working(self) -> AsyncIterator[None]:
        """Count what may change a file of an import, from its first to its last moment."""
        if self._service.safe is None:
            await self._settled.wait()
        self._begin_work()
        try:
            yield
        finally:
            self._end_work()

    def _begin_work(self) -> None:
        self._at_work += 1
        self._idle.clear()

    def _end_work(self) -> None:
        self._at_work -= 1
        if self._at_work == 0:
            self._idle.set()

    def _is_leaving(self) -> bool:
        return self._resting or self._service.draining

    def name(self, key: str | None) -> str:
        """Return the id of the import that is made under this key of a request."""
        if key is None:
            return self._service.new_id()
        digest = bytearray(hashlib.sha256(b"import\0" + key.encode()).digest()[:16])
        digest[6], digest[8] = digest[6] & 0x0F | 0x80, digest[8] & 0x3F | 0x80  # the bits of a UUIDv8
        return str(UUID(bytes=bytes(digest)))

    async def begin(self, import_id: str) -> Path | Trouble:
        """Return the file to write an upload into. Where it is one, give it to `end` when all is done."""
        if self._is_leaving():
            return Trouble("leaving")
        if self._service.safe is not None:
            known = isinstance(await self.get(import_id), Kept)
            return reading_only(self._service.safe, done_before=known)
        async with self._working():
            if self._is_leaving():
                return Trouble("leaving")
            if import_id in self._uploads or len(self._uploads) >= UPLOADS_MAX:
                return Trouble("busy")
            self._uploads.add(import_id)
            try:
                folder = await asyncio.to_thread(self._imports.begin, import_id)
            except BaseException:
                self._uploads.discard(import_id)
                raise
            self._begin_work()  # until `end`
        return folder.file

    async def end(self, import_id: str) -> None:
        """Throw away what `take_in` has not kept."""
        try:
            await asyncio.to_thread(self._imports.abandon, import_id)
        finally:
            self._uploads.discard(import_id)
            self._end_work()

    async def take_in(
        self, import_id: str, name: str, sha256: str, choices: Choices, password: str | None
    ) -> Kept | Trouble:
        """Read the file that was written and keep the import. `name` is what the client calls the file."""
        before = await self.get(import_id)
        if isinstance(before, Kept):
            same = before.manifest.sha256 == sha256
            return msgspec.structs.replace(before, replayed=True) if same else Trouble("key-reused")
        folder = self._imports.unfinished(import_id)
        name = name[:NAME_CHARACTERS_MAX]
        until_ns = self._looker.deadline_ns()
        table = await self._looker.read(folder, choices.encoding, password, until_ns)
        if isinstance(table, Trouble):
            return table
        size = folder.file.stat().st_size
        made = Manifest(import_id, State.PREVIEW, name, size, sha256, time.time_ns(), choices.encoding)
        looked = await self._looker.look(table, made, choices, until_ns, anew=True)
        if isinstance(looked, Trouble):
            return looked
        await asyncio.to_thread(folder.keep_rows, table.path)
        await asyncio.to_thread(folder.keep_survey, looked.survey)
        await asyncio.to_thread(folder.keep_manifest, looked.manifest)
        await asyncio.to_thread(self._imports.finish, import_id)
        await self._tidy()
        return await self.get(import_id)

    async def get(self, import_id: str) -> Kept | Trouble:
        """Return an import."""
        folder = self._imports.open(import_id) if is_import_id(import_id) else None
        manifest = await asyncio.to_thread(folder.manifest) if folder is not None else None
        if folder is None or manifest is None:
            return Trouble("import-not-found")
        return await self._kept(folder, manifest)

    async def newest(self) -> list[Kept]:
        """Return the newest imports."""
        found = await asyncio.to_thread(self._imports.newest_first)
        return [await self._kept(self._imports.open(one.id), one) for one in found[:LISTED_MAX]]

    async def preview(self, import_id: str, choices: Choices) -> Kept | Trouble:
        """Look at the kept file again, with other choices."""
        async with self._working():
            return Trouble("leaving") if self._is_leaving() else await self._look_again(import_id, choices)

    async def _look_again(self, import_id: str, choices: Choices) -> Kept | Trouble:
        kept = await self.get(import_id)
        if isinstance(kept, Trouble):
            return kept
        if after(kept.manifest.state, Trigger.READ_AGAIN) is None:
            return Trouble("import-committed")
        if self._service.safe is not None:
            return reading_only(self._service.safe)
        folder = self._imports.open(import_id)
        until_ns = self._looker.deadline_ns()
        anew = choices.encoding is not None and choices.encoding != kept.manifest.encoding
        table = (
            await self._looker.read(folder, choices.encoding, None, until_ns)
            if anew
            else kept.table or unreadable(KEPT_FILE_LOST)
        )
        if isinstance(table, Trouble):
            return table
        manifest = msgspec.structs.replace(kept.manifest, encoding=choices.encoding or kept.manifest.encoding)
        try:
            looked = await self._looker.look(table, manifest, choices, until_ns, anew=anew)
            fresh = table.path if anew else None
            return looked if isinstance(looked, Trouble) else await self._keep_look(folder, looked, fresh)
        finally:
            if anew:  # rows that were not kept; kept ones have another name by now
                await asyncio.to_thread(table.path.unlink, missing_ok=True)

    async def commit(self, import_id: str, choices: Choices, *, skip_duplicates: bool) -> Kept | Trouble:
        """Wish that the rows are booked. Once this returns an import, they will be, whatever dies."""
        async with self._working(), self._changing:
            if self._is_leaving():
                return Trouble("leaving")
            kept = await self.get(import_id)
            if isinstance(kept, Trouble):
                return kept
            wish = msgspec.structs.replace(
                kept.manifest,
                account=choices.account or kept.manifest.account,
                mapping=choices.mapping or kept.manifest.mapping,
                skip_duplicates=skip_duplicates,
            )
            trigger = Trigger.COMMIT if wish == kept.manifest else Trigger.COMMIT_OTHERWISE
            state = after(kept.manifest.state, trigger)
            if state is None:
                return Trouble("import-committed")
            if state is kept.manifest.state:
                return kept
            return await self._commit(kept, wish, state)

    async def _commit(self, kept: Kept, wish: Manifest, state: State) -> Kept | Trouble:
        if self._service.safe is not None:
            return reading_only(self._service.safe)
        if kept.table is None:
            return unreadable(KEPT_FILE_LOST)
        if wish.account is None:
            return Trouble("import-without-account")
        account = await self._looker.account(wish.account)
        if isinstance(account, Trouble):
            return account
        faults = faults_of(wish.mapping, kept.table.columns)
        if faults:
            return Trouble("import-mapping", faults=faults)
        wish = msgspec.structs.replace(wish, state=state, currency=account.currency)
        folder = self._imports.open(wish.id)
        await asyncio.to_thread(folder.keep_manifest, wish)
        self._importer.add(_job(folder, wish, kept.table, Progress()))
        return msgspec.structs.replace(kept, manifest=wish, progress=Progress())

    async def _go_on(self, manifest: Manifest) -> None:
        """Take up what a death has interrupted. What can't be gone on with ends by itself, and nothing else does."""
        folder = self._imports.open(manifest.id)
        progress = await asyncio.to_thread(folder.progress)
        table = await asyncio.to_thread(open_table, folder.rows)
        if isinstance(table, Unreadable):
            self._importer.add(broken(folder, manifest, progress, KEPT_FILE_LOST))
            return
        try:
            job = _job(folder, manifest, table, progress)
            job.one_by_one = progress.done + ONE_BY_ONE_ROWS  # one of them may be what the last core died of
        # The records of another life, or another version: no core may fail to start because of them.
        except Exception:
            logger.exception("Import %s can't be gone on with", manifest.id)
            job = broken(folder, manifest, progress, FAILED_INSIDE)
        self._importer.add(job)

    async def _keep_look(self, folder: ImportFolder, looked: Looked, fresh: Path | None) -> Kept | Trouble:
        """Keep what was seen, and with it the rows that were read for it, if any were."""
        async with self._changing:
            now = await asyncio.to_thread(folder.manifest)
            if now is None or after(now.state, Trigger.READ_AGAIN) is None:
                return Trouble("import-committed")  # in another tab, while this one was looking
            if fresh is not None:
                await asyncio.to_thread(folder.keep_rows, fresh)
            await asyncio.to_thread(folder.keep_survey, looked.survey)
            await asyncio.to_thread(folder.keep_manifest, looked.manifest)
            return await self._kept(folder, looked.manifest)

    async def _kept(self, folder: ImportFolder, manifest: Manifest) -> Kept:
        job = self._importer.job(manifest.id)
        progress = job.progress if job is not None else await asyncio.to_thread(folder.progress)
        table = await asyncio.to_thread(open_table, folder.rows)
        found = await asyncio.to_thread(folder.survey)
        waiting = job.waiting if job is not None else None
        rows = None if isinstance(table, Unreadable) else table
        return Kept(manifest, rows, found, progress, waiting=waiting)

    async def _tidy(self) -> None:
        settings = self._service.settings
        before_ns = time.time_ns() - settings.import_preview_days * DAY_NS
        async with self._changing:  # a wish that came since would be swept away by what was seen before
            await asyncio.to_thread(
                self._imports.tidy, before_ns, settings.imports_bytes_max, settings.imports_max
            )


def _job(folder: ImportFolder, manifest: Manifest, table: ReadTable, progress: Progress) -> Job:
    """Return the work that is left after `progress`."""
    rows_anew = partial(results, manifest, table)
    return Job(folder, manifest, table.head.row_count, rows_anew(), progress, rows_anew=rows_anew)
