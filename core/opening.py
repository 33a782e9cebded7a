"""Opening the book: lock, store, fence, proof, in this order, or the reason why not.

It blocks and knows no event loop; the caller gives it a thread, so that a core which proves a long tail still
shows signs of life. The epoch is told to the guard the moment the fence is committed and before the proof:
from then on no older core can commit, whatever the proof will say.
"""

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from sqlalchemy import Connection
from sqlalchemy.exc import DBAPIError

from core import departure
from core.departure import Departure
from core.guarded.beacon import Beacon
from core.guarded.recorder import FlightRecorder
from core.journal import disk
from core.journal.ahead import Ahead
from core.journal.append import Journal
from core.journal.chain import Broken, EventRow
from core.journal.fence import Fenced, NotOurs, Raised, StoreWentBack, fence
from core.journal.lock import DoorClosed, StartGuard, take_start_guard
from core.journal.proof import Proven, Witness, prove
from core.journal.room import Room
from core.journal.store import LEDGER_FILE, StoreError, StoreFault, open_writing, store_error
from core.settings import Settings

ASK_EVERY_S: Final = 1.0
MORE_TIME_USEC: Final = 5_000_000  # several times that, so one lost asking does not end a start


@dataclass(frozen=True, slots=True)
class OpenBook:
    """A proven book that this core, and no other, may write to."""

    journal: Journal
    epoch: int
    proof: Proven
    guard: StartGuard


@dataclass(frozen=True, slots=True)
class Telling:
    """Whom to tell while the book is being opened."""

    recorder: FlightRecorder
    beacon: Beacon


@dataclass(frozen=True, slots=True)
class Terms:
    """On what terms a book is taken over.

    `expected_epoch`: from which epoch it is raised; None: from whatever stands in the store. `witnesses`: commits
    that somebody saw, which must be there. `busy_ms`: how long the fence waits for the store's lock; None: as
    the settings say. `shared`: somebody sees to it that one core writes; else the folder is this core's alone.
    """

    expected_epoch: int | None
    witnesses: tuple[Witness, ...]
    busy_ms: int | None
    shared: bool


def open_book(
    data: Path, terms: Terms, settings: Settings, telling: Telling, ahead: Ahead | None = None
) -> OpenBook | Departure:
    """Take the book of a data folder over, raising its epoch, and prove its tail. Blocks.

    `ahead`: what this very process has seen of the chain already. It is at its end with this.
    """
    guard = take_start_guard(data, shared=terms.shared)
    if isinstance(guard, DoorClosed):
        return _not_let_in(guard)
    connection = open_writing(
        data / LEDGER_FILE, settings.fence_busy_ms if terms.busy_ms is None else terms.busy_ms
    )
    if isinstance(connection, StoreError):
        return _unopened(connection, data, telling)
    epoch = _take_over(connection, terms.expected_epoch, telling)
    if isinstance(epoch, StoreError):
        return _unopened(epoch, data, telling)
    if isinstance(epoch, Departure):
        return epoch
    proof = _prove(connection, terms, ahead or Ahead(settings.tail_events), telling)
    if isinstance(proof, StoreError):
        return _unproven(proof, data)
    if isinstance(proof, Departure):
        return proof
    connection.exec_driver_sql(f"PRAGMA busy_timeout = {settings.write_busy_ms}").close()
    room = Room(data, time.monotonic_ns)
    journal = Journal(connection, epoch, proof.head_seq, telling.recorder, room, time.time_ns)
    return OpenBook(journal, epoch, proof, guard)


def _not_let_in(door: DoorClosed) -> Departure:
    """A lock that a disk refuses is the disk's doing and no mistake in a setting."""
    error = disk.refused(door.number)
    return departure.config_invalid(door.sentence) if error is None else _of_store(error)


def _take_over(
    connection: Connection, expected: int | None, telling: Telling
) -> int | StoreError | Departure:
    outcome = fence(connection, expected)
    match outcome:
        case Raised(epoch):
            telling.recorder.set_epoch(epoch)
            telling.beacon.epoch_raised(epoch)
            return epoch
        case Fenced(actual):
            return departure.fenced(expected or 0, actual)
        case StoreWentBack(actual, wanted):
            return departure.corrupt(f"it stands at epoch {actual}, but epoch {wanted} had been raised")
        case NotOurs(None):
            return departure.config_invalid(
                f"{LEDGER_FILE} is a database of something else: choose another folder."
            )
        case NotOurs(version):
            return departure.config_invalid(
                f"{LEDGER_FILE} has schema {version}, made by another version of this program: use that version."
            )
        case StoreError():
            return outcome


def _prove(
    connection: Connection, terms: Terms, ahead: Ahead, telling: Telling
) -> Proven | StoreError | Departure:
    # A witness of nothing (a predecessor that committed nothing) is nobody's word about any event.
    witnesses = [witness for witness in terms.witnesses if witness.seq > 0]
    try:
        connection.exec_driver_sql("BEGIN").close()
        tail = ahead.tail(connection, witnesses)
        if isinstance(tail, Broken):
            return departure.corrupt(tail.sentence)
        rows = asking_for_time(tail.rows, telling.beacon.extend, time.monotonic)
        proof = prove(replace(tail, rows=rows), witnesses)
        connection.exec_driver_sql("ROLLBACK").close()
    except DBAPIError as error:
        return store_error(error)
    return departure.corrupt(proof.sentence) if isinstance(proof, Broken) else proof


def asking_for_time(
    rows: Iterable[EventRow], extend: Callable[[int], None], now_s: Callable[[], float]
) -> Iterator[EventRow]:
    """Pass the events on; while a long proof makes progress, ask the guard for more time to start in."""
    asked_s = now_s()
    for row in rows:
        if now_s() - asked_s >= ASK_EVERY_S:
            asked_s = now_s()
            extend(MORE_TIME_USEC)
        yield row


def _unopened(error: StoreError, data: Path, telling: Telling) -> Departure:
    if error.fault is StoreFault.BUSY:
        telling.beacon.fence_blocked()
        return _of_store(error)
    # What it says of a disk that takes no writes depends on where it met that: the disk itself is asked first.
    return _of_store(disk.refusal(data) or error)


def _unproven(error: StoreError, data: Path) -> Departure:
    refused = disk.refusal(data)
    return departure.corrupt(f"it can't be read ({error.text})") if refused is None else _of_store(refused)


def _of_store(error: StoreError) -> Departure:
    match error.fault:
        case StoreFault.BUSY:
            return departure.locked(error.text)
        case StoreFault.NO_ROOM:
            return departure.no_room(error.text)
        case StoreFault.READ_ONLY:
            return departure.read_only(error.text)
        case StoreFault.DAMAGED:
            return departure.corrupt(f"it can't be opened ({error.text})")
        case StoreFault.OTHER:
            return departure.commit_failed(error.text)
