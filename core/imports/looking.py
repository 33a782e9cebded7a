"""Looking at a file: read in a child, surveyed on a thread, held against the book; nothing is booked.

All of it may honestly take seconds, so it takes no slot (a guard would read a slot without progress as a hang)
and has a bound of its own. The questions to the book do take slots, as everybody's do, and without a payload:
a file's bytes, and a password above all, have no place in evidence.
"""

import asyncio
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Final, TypeVar

import msgspec
from sqlalchemy import Connection

from core.imports.folder import ImportFolder
from core.imports.reading.candidates import Result
from core.imports.reading.child import read_in_child
from core.imports.reading.formats import builtin_formats
from core.imports.reading.kept import ReadTable
from core.imports.reading.limits import ReadingLimits
from core.imports.reading.mapping import FaultKind, Mapping, MappingFault, faults_of
from core.imports.reading.proposal import propose
from core.imports.reading.rows import parse_rows
from core.imports.reading.table import Unreadable
from core.imports.records import Manifest, Survey
from core.imports.survey import survey
from core.imports.troubles import Trouble, unreadable
from core.journal import queries
from core.journal.store import StoreError
from core.ledger.accounts import Account
from core.service import Draining, NoSlot, ReadTooLong, Service

T = TypeVar("T")

LOOKS_AT_A_TIME: Final = 2
FINGERPRINTS_AT_A_TIME: Final = 2_000
READING_MS_MAX: Final = 20_000  # a gateway waits 30 s for an answer
NAMED_MAX: Final = 128  # characters of somebody's text that a sentence repeats


@dataclass(frozen=True, slots=True)
class Choices:
    """What a person chose; None: as it was, or as the file says. `format` "": none of the known ones."""

    account: str | None = None
    mapping: Mapping | None = None
    format: str | None = None
    encoding: str | None = None


@dataclass(frozen=True, slots=True)
class Looked:
    """What was seen: the wish with everything filled in, and the numbers."""

    manifest: Manifest
    survey: Survey


class Looker:
    """Looks at files. All methods on the loop's thread."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._room = asyncio.Semaphore(LOOKS_AT_A_TIME)

    async def read(
        self, folder: ImportFolder, encoding: str | None, password: str | None
    ) -> ReadTable | Trouble:
        """Read the folder's file into fresh rows. What was read before stays until they are kept or removed."""
        fresh = folder.fresh_rows(self._service.new_id())
        limits = ReadingLimits(
            file_bytes_max=self._service.settings.import_file_bytes_max, wall_ms_max=READING_MS_MAX
        )
        async with self._room:
            read = await read_in_child(
                folder.file, encoding=encoding, password=password, out=fresh, limits=limits
            )
        if isinstance(read, Unreadable):
            await asyncio.to_thread(fresh.unlink, missing_ok=True)
            return unreadable(read.reason.value, read.line)
        return read

    async def look(
        self, table: ReadTable, manifest: Manifest, choices: Choices, *, anew: bool
    ) -> Looked | Trouble:
        """Return how the table would be booked with these choices. `anew`: nothing was chosen for it before."""
        account_id = choices.account or manifest.account
        account = await self.account(account_id) if account_id is not None else None
        if isinstance(account, Trouble):
            return account
        formats = builtin_formats()
        wanted = choices.format if anew or choices.format is not None else manifest.format or ""
        if wanted and wanted not in formats:
            return Trouble("import-format-unknown", {"format": wanted[:NAMED_MAX]})
        proposal = await asyncio.to_thread(propose, table, formats, wanted)
        kept = None if anew or choices.format is not None else manifest.mapping
        filled = msgspec.structs.replace(
            manifest,
            format=proposal.format,
            mapping=choices.mapping or kept or proposal.mapping,
            account=account_id,
            currency=account.currency if account else None,
        )
        if blocking(faults_of(filled.mapping, table.columns)):
            return Looked(filled, Survey(table.head.row_count, fitting=proposal.fitting))
        found = await self._survey(filled, table, proposal.fitting)
        return found if isinstance(found, Trouble) else Looked(filled, found)

    async def account(self, account_id: str) -> Account | Trouble:
        """Return the account that rows are to be booked on."""
        found = await self._ask("read.account", lambda c: queries.get_account(c, account_id))
        if found is None:
            return Trouble("account-not-found", {"account": account_id[:NAMED_MAX]})
        return found

    async def _survey(
        self, manifest: Manifest, table: ReadTable, fitting: tuple[str, ...]
    ) -> Survey | Trouble:
        async with self._room:
            surveyor = await asyncio.to_thread(
                lambda: survey(results(manifest, table), manifest.account, manifest.currency)
            )
        duplicates = 0
        seen = surveyor.fingerprints
        for at in range(0, len(seen), FINGERPRINTS_AT_A_TIME):
            some = seen[at : at + FINGERPRINTS_AT_A_TIME]
            known = await self._ask("read.fingerprints", partial(_known, some))
            if isinstance(known, Trouble):
                return known
            duplicates += known
        return surveyor.found(duplicates, fitting)

    async def _ask(self, kind: str, question: Callable[[Connection], T]) -> T | Trouble:
        slot = self._service.begin(kind, b"")
        if isinstance(slot, NoSlot):
            return Trouble("busy")
        if isinstance(slot, Draining):
            return Trouble("leaving")
        status = 503
        try:
            found = await self._service.read(slot, question)
            if isinstance(found, ReadTooLong):
                return Trouble("read-too-long")
            if isinstance(found, StoreError):
                return Trouble("store-unreadable")
            status = 200
            return found
        finally:
            self._service.finish(slot, status)


def results(manifest: Manifest, table: ReadTable) -> Iterator[Result]:
    """Return what each row of the table is under this wish, in order, always the same."""
    form = builtin_formats().get(manifest.format) if manifest.format is not None else None
    return parse_rows(table, manifest.mapping, form, manifest.currency)


def blocking(faults: tuple[MappingFault, ...]) -> bool:
    """Whether rows can't even be looked at: an unknown order of dates only refuses those it leaves unclear."""
    return any(fault.kind is not FaultKind.NO_DATE_FORMAT for fault in faults)


def _known(fingerprints: list[str], connection: Connection) -> int:
    return len(queries.known_fingerprints(connection, fingerprints))
