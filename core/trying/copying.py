"""The copy of a ledger for whoever throws it away: made beside the core that writes to it, and only where there is room.

The room is asked for before, and what stays free afterwards is more than what a guard calls a full disk: a trial must not
bring about what it was not asked to look into. What only the superuser may fill is not counted as room, whoever we are.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec
from sqlalchemy.exc import DBAPIError

from core.journal import ballast, queries
from core.journal.carrying import copy_now
from core.journal.room import free_bytes
from core.journal.store import (
    LEDGER_FILE,
    StoreError,
    StoreFault,
    Whereabouts,
    open_reading,
    size_bytes,
    snapshot,
    store_error,
)

READ_MS_MAX: Final = 5_000
BUSY_MS: Final = 2_000
SPARED_BYTES: Final = ballast.ROOM_BYTES  # stay free beside a copy and what trials add to it


class Copy(msgspec.Struct, frozen=True):
    """A copy as it is: its last event with its hash, and how many bytes it has."""

    seq: int
    hash: bytes
    size_bytes: int


class TooLarge(msgspec.Struct, frozen=True):
    """The ledger has more bytes than may be copied."""

    size_bytes: int


def copy_into(
    folder: Path, ledger: Whereabouts, bytes_max: int, tick: Callable[[], object]
) -> Copy | TooLarge | StoreError:
    """Copy a ledger into a folder. Blocks; `tick` may raise."""
    has_bytes = _look(ledger)
    if isinstance(has_bytes, StoreError):
        return has_bytes
    if has_bytes.size_bytes > bytes_max:
        return TooLarge(has_bytes.size_bytes)
    free = free_bytes(os.statvfs(folder), reserve_is_ours=False)
    if free is not None and free < has_bytes.size_bytes + SPARED_BYTES:
        text = (
            f"ENOSPC: {free} bytes are free, a copy of {has_bytes.size_bytes} needs {SPARED_BYTES} beside it"
        )
        return StoreError(StoreFault.NO_ROOM, text)
    error = copy_now(ledger, folder / LEDGER_FILE, tick)
    return error or _look(folder / LEDGER_FILE)


def _look(ledger: Whereabouts) -> Copy | StoreError:
    engine = open_reading(ledger, 1, BUSY_MS)
    try:
        with snapshot(engine, READ_MS_MAX) as connection:
            row = queries.head(connection)
            return Copy(row.head_seq, row.head_hash, size_bytes(connection))
    except DBAPIError as error:
        return store_error(error)
    finally:
        engine.dispose()
