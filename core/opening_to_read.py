"""Opening the book to read it only: no fence, no proof, no change of the book, for a core that was started safe.

Such a core is started where a restart alone would not help: the disk takes no write, or the book is damaged. It
raises no epoch, so nothing that it says is newer than what the dead core left, and it proves nothing: whoever can
be shown the book is shown it as it stands. SQLite reads a book with a log through a shared index beside it: where
they are missing it makes the index and an empty log, and both stay behind. A full or read-only disk may not be able
to hold them; the file alone is read then, if nothing is left in the log. Whoever reads so sees nothing of what others
write meanwhile, so it is never done where somebody holds the store: this core leaves with a sentence then, as it does
where there is something in the log. Not chosen: a copy in memory, which a long ledger would not fit into.
"""

from pathlib import Path
from typing import Final, assert_never

import msgspec
from sqlalchemy import Connection, Engine
from sqlalchemy.exc import DBAPIError

from core import departure
from core.departure import Departure
from core.guarded.environment import GuardedEnvironment
from core.journal import disk, queries, schema
from core.journal.lock import DoorClosed, StartGuard, take_start_guard
from core.journal.store import (
    LEDGER_FILE,
    Server,
    StoreError,
    StoreFault,
    Whereabouts,
    has_ledger,
    open_reading,
    snapshot,
    store_error,
    tables_of,
)
from core.settings import Settings

#: What a disk says that can't hold the log's index. Not BUSY: somebody is at work on the file then.
_WITHOUT_INDEX: Final = frozenset({StoreFault.NO_ROOM, StoreFault.READ_ONLY, StoreFault.OTHER})


_DAMAGED: Final = "STORE_CORRUPT"


class ReadableBook(msgspec.Struct, frozen=True):
    """A book that this core reads and never writes to. `epoch` and head as they stand in the store."""

    readers: Engine
    epoch: int
    head_seq: int
    head_hash: bytes
    guard: StartGuard


class _NotOurs(msgspec.Struct, frozen=True):
    """The file is no ledger that this version can read as it stands. `version`: of a ledger, its schema."""

    version: int | None = None


class _Head(msgspec.Struct, frozen=True):
    version: int
    epoch: int
    seq: int
    hash: bytes


def open_to_read(data: Path, environment: GuardedEnvironment, settings: Settings) -> ReadableBook | Departure:
    """Open the book of a data folder as it stands. Blocks."""
    guard = take_start_guard(data, shared=environment.guarded, reading=True)
    if isinstance(guard, DoorClosed):
        return departure.config_invalid(guard.sentence)
    where = settings.ledger(data)
    if not has_ledger(where, settings.fence_busy_ms):
        return departure.config_invalid(f"There is no ledger in {data}: name its folder with --data.")
    opened = _open(where, settings, alone=False)
    if isinstance(opened, StoreError) and opened.fault in _WITHOUT_INDEX and _is_whole(where):
        opened = _open(where, settings, alone=True)
    match opened:
        case StoreError():
            return _unread(opened, data)
        case _NotOurs(version):
            return _unreadable(version, environment.safe)
        case (readers, head) if head.seq == 0 and environment.safe == _DAMAGED:
            # An empty book shown to somebody whose records are missing would say that there were none.
            readers.dispose()
            return departure.corrupt("there is nothing in it to be read")
        case (readers, head):
            return ReadableBook(readers, head.epoch, head.seq, head.hash, guard)


def _open(
    where: Whereabouts, settings: Settings, *, alone: bool
) -> tuple[Engine, _Head] | _NotOurs | StoreError:
    # One more connection than reading threads: the proof of the whole book has its own.
    readers = open_reading(where, settings.readers + 1, settings.write_busy_ms, alone=alone)
    found: _Head | _NotOurs | StoreError
    try:
        with snapshot(readers, settings.read_ms_max) as connection:
            found = _head(connection)
    except DBAPIError as error:
        found = store_error(error)
    if isinstance(found, _Head) and found.version == schema.SCHEMA_VERSION:
        return readers, found
    readers.dispose()
    if not isinstance(found, _Head):
        return found
    views = schema.views_over(found.version)
    return open_reading(where, settings.readers + 1, settings.write_busy_ms, alone=alone, first=views), found


def _head(connection: Connection) -> _Head | _NotOurs:
    if "meta" not in tables_of(connection):
        return _NotOurs()
    row = queries.head(connection)
    if not schema.SCHEMA_VERSION_READABLE <= row.schema_version <= schema.SCHEMA_VERSION:
        return _NotOurs(row.schema_version)
    return _Head(row.schema_version, row.epoch, row.head_seq, row.head_hash)


def _unreadable(version: int | None, safe: str | None) -> Departure:
    """An old ledger is taken along as soon as its disk takes a write: then the disk is what is wrong, and passes."""
    if version is not None and schema.SCHEMA_VERSION_OLDEST <= version < schema.SCHEMA_VERSION_READABLE:
        text = (
            f"and a ledger of schema {version} can't be read before it is brought to {schema.SCHEMA_VERSION}"
        )
        match safe:
            case "DISK_FULL":
                return departure.no_room(text)
            case "DISK_READ_ONLY":
                return departure.read_only(text)
            case _:
                pass
    return departure.config_invalid(
        f"{LEDGER_FILE} is no ledger that this version can read without changing it."
    )


def _is_whole(path: Whereabouts) -> bool:
    """Whether all of the book is in its file: nothing is left in the log. Looked at from outside."""
    if isinstance(path, Server):
        return False
    log = path.with_name(f"{path.name}-wal")
    return not log.exists() or log.stat().st_size == 0


def _unread(error: StoreError, data: Path) -> Departure:
    refused = disk.refusal(data) if error.fault is StoreFault.OTHER else None
    match (refused or error).fault:
        case StoreFault.DAMAGED:
            return departure.corrupt(f"not even its head can be read ({error.text})")
        case StoreFault.BUSY:
            return departure.locked(error.text)
        case StoreFault.AWAY:
            return departure.away(error.text)
        case StoreFault.UNFIT:
            return departure.unfit(error.text)
        case StoreFault.READ_ONLY:
            return departure.read_only(f"and its log can't be read without a write: {error.text}")
        case StoreFault.NO_ROOM | StoreFault.TAKEN | StoreFault.OTHER:
            return departure.no_room(f"and the ledger can't be read without one: {error.text}")
        case _ as never:
            assert_never(never)
