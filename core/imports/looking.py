"""Looking at a file: read in a child, surveyed on a thread, held against the book; nothing is booked.

All of it may honestly take seconds, so it takes no slot (a guard would read a slot without progress as a hang)
and has a bound of its own. The questions to the book do take slots, as everybody's do, and without a payload:
a file's bytes, and a password above all, have no place in evidence.
"""

import asyncio
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Final, TypeVar

import msgspec
from sqlalchemy import Connection

from core.imports.folder import ImportFolder
from core.imports.reading.candidates import Result
from core.imports.reading.child import read_in_child
from core.imports.reading.formats import Format
from core.imports.reading.kept import ReadTable
from core.imports.reading.limits import ReadingLimits
from core.imports.reading.mapping import FaultKind, Mapping, MappingFault, faults_of
from core.imports.reading.own_formats import FOLDER, Known, known_formats, with_own
from core.imports.reading.proposal import Proposal, fitting_formats, guessed_anew, propose
from core.imports.reading.rows import parse_rows
from core.imports.reading.table import Row, Table, Unreadable, Why
from core.imports.records import Manifest, Survey
from core.imports.survey import survey
from core.imports.troubles import Trouble, unreadable
from core.journal import queries
from core.journal.store import StoreError
from core.ledger.accounts import Account
from core.service import ReadTooLong, Service
from core.slots import Draining, NoSlot, holding_slot

T = TypeVar("T")

LOOKS_AT_A_TIME: Final = 2
FINGERPRINTS_AT_A_TIME: Final = 2_000
GUESSED: Final = ("date_format", "decimal")
NAMED_MAX: Final = 128  # characters of somebody's text that a sentence repeats


class Choices(msgspec.Struct, frozen=True):
    """What a person chose; None: as it was, or as the file says. `format` "": none of the known ones."""

    account: str | None = None
    mapping: Mapping | None = None
    format: str | None = None
    encoding: str | None = None


class Looked(msgspec.Struct, frozen=True):
    """What was seen: the wish with everything filled in, and the numbers."""

    manifest: Manifest
    survey: Survey


class TooLateError(Exception):
    """A look has taken as long as it may."""


class Timed(msgspec.Struct, frozen=True):
    """A table whose rows come until a moment of the monotonic clock: a thread can't be called off otherwise."""

    table: ReadTable
    until_ns: int

    @property
    def columns(self) -> tuple[str, ...]:
        """The unique names of the columns."""
        return self.table.columns

    def rows(self) -> Iterator[Row]:
        """The rows below the header. TooLateError once the moment has come."""
        for row in self.table.rows():
            if time.monotonic_ns() > self.until_ns:
                raise TooLateError
            yield row


class Looker:
    """Looks at files. All methods on the loop's thread."""

    def __init__(self, service: Service, data: Path | None = None) -> None:
        """Take the data folder, in which the household's own layouts are looked for; None: it has none."""
        self._service = service
        self._formats = None if data is None else data / FOLDER
        self._room = asyncio.Semaphore(LOOKS_AT_A_TIME)

    def deadline_ns(self) -> int:
        """Return until when a look that begins now, and the reading before it, may take."""
        return time.monotonic_ns() + self._service.settings.import_looking_ms * 1_000_000

    async def read(
        self, folder: ImportFolder, encoding: str | None, password: str | None, until_ns: int
    ) -> ReadTable | Trouble:
        """Read the folder's file into fresh rows. What was read before stays until they are kept or removed."""
        fresh = folder.fresh_rows(self._service.new_id())
        async with self._room:
            left_ms = max(1, (until_ns - time.monotonic_ns()) // 1_000_000)
            limits = ReadingLimits(
                file_bytes_max=self._service.settings.import_file_bytes_max, wall_ms_max=left_ms
            )
            read = await read_in_child(
                folder.file,
                encoding=encoding,
                password=password,
                out=fresh,
                limits=limits,
                formats=self._formats,
            )
        if isinstance(read, Unreadable):
            await asyncio.to_thread(fresh.unlink, missing_ok=True)
            return unreadable(read.reason.value, read.line)
        return read

    async def look(
        self, table: ReadTable, manifest: Manifest, choices: Choices, until_ns: int, *, anew: bool
    ) -> Looked | Trouble:
        """Return how the table would be booked with these choices. `anew`: nothing was chosen for it before."""
        try:
            return await self._look(Timed(table, until_ns), manifest, choices, anew=anew)
        except TooLateError:
            return unreadable(Why.TOO_SLOW.value)

    async def _look(
        self, table: Timed, manifest: Manifest, choices: Choices, *, anew: bool
    ) -> Looked | Trouble:
        account_id = choices.account or manifest.account
        account = await self.account(account_id) if account_id is not None else None
        if isinstance(account, Trouble):
            return account
        known = await asyncio.to_thread(known_formats, self._formats)
        formats = known.formats
        wanted = choices.format if anew or choices.format is not None else manifest.format or ""
        if wanted and wanted not in formats:
            return Trouble("import-format-unknown", {"format": wanted[:NAMED_MAX]})
        proposal = await asyncio.to_thread(propose, table, formats, wanted)
        mapping, chosen = proposal.mapping, manifest.chosen
        if anew or choices.format is not None:
            mapping, chosen = choices.mapping or mapping, ()
        elif choices.mapping is None:
            mapping = manifest.mapping
        else:
            set_now = _set_by_hand(manifest.mapping, choices.mapping)
            chosen = tuple(field for field in GUESSED if field in {*chosen, *set_now})
            mapping = await asyncio.to_thread(guessed_anew, table, manifest.mapping, choices.mapping, chosen)
        filled = msgspec.structs.replace(
            manifest,
            format=proposal.format,
            mapping=mapping,
            chosen=chosen,
            account=account_id,
            currency=account.currency if account else None,
            own_formats=_own(known, proposal),
        )
        if blocking(faults_of(filled.mapping, table.columns)):
            bare = Survey(table.table.head.row_count, fitting=proposal.fitting, broken_formats=known.broken)
            return Looked(filled, bare)
        found = await self._survey(filled, table, proposal.fitting)
        if isinstance(found, Trouble):
            return found
        return Looked(filled, msgspec.structs.replace(found, broken_formats=known.broken))

    async def account(self, account_id: str) -> Account | Trouble:
        """Return the account that rows are to be booked on."""
        found = await self._ask("read.account", lambda c: queries.get_account(c, account_id))
        if found is None:
            return Trouble("account-not-found", {"account": account_id[:NAMED_MAX]})
        return found

    async def _survey(self, manifest: Manifest, table: Timed, fitting: tuple[str, ...]) -> Survey | Trouble:
        async with self._room:
            surveyor = await asyncio.to_thread(
                lambda: survey(results(manifest, table), manifest.account, manifest.currency)
            )
        duplicates = 0
        seen = surveyor.fingerprints
        for at in range(0, len(seen), FINGERPRINTS_AT_A_TIME):
            if time.monotonic_ns() > table.until_ns:
                raise TooLateError
            some = seen[at : at + FINGERPRINTS_AT_A_TIME]
            known = await self._ask("read.fingerprints", partial(_known, some))
            if isinstance(known, Trouble):
                return known
            duplicates += known
        return surveyor.found(duplicates, fitting)

    async def _ask(self, kind: str, question: Callable[[Connection], T]) -> T | Trouble:
        with holding_slot(self._service, kind, b"") as held:
            if isinstance(held, NoSlot):
                return Trouble("busy")
            if isinstance(held, Draining):
                return Trouble("leaving")
            found = await self._service.read(held.slot, question)
            if isinstance(found, ReadTooLong | StoreError):
                held.status = 503
                return Trouble("read-too-long" if isinstance(found, ReadTooLong) else "store-unreadable")
            held.status = 200
            return found


def results(manifest: Manifest, table: Table) -> Iterator[Result]:
    """Return what each row of the table is under this wish, in order, always the same."""
    formats = with_own(manifest.own_formats)
    form = formats.get(manifest.format) if manifest.format is not None else None
    of_header = next(iter(fitting_formats(table.columns, formats)), None)
    return parse_rows(table, manifest.mapping, form, manifest.currency, of_header)


def _own(known: Known, proposal: Proposal) -> tuple[Format, ...]:
    """The household's own layouts that this file goes by: kept with it, so that its rows never become others."""
    names = dict.fromkeys((proposal.format, *proposal.fitting))
    return tuple(known.own[name] for name in names if name is not None and name in known.own)


def _set_by_hand(before: Mapping, now: Mapping) -> Iterator[str]:
    return (field for field in GUESSED if getattr(now, field) != getattr(before, field))


def blocking(faults: tuple[MappingFault, ...]) -> bool:
    """Whether rows can't even be looked at: an unknown order of dates only refuses those it leaves unclear."""
    return any(fault.kind is not FaultKind.NO_DATE_FORMAT for fault in faults)


def _known(fingerprints: list[str], connection: Connection) -> int:
    return len(queries.known_fingerprints(connection, fingerprints))
