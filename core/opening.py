"""Opening the book: lock, store, fence, proof, in this order, or the reason why not.

It blocks and knows no event loop; the caller gives it a thread, so that a core which proves a long tail still
shows signs of life. The epoch is told to the guard the moment the fence is committed and before the proof:
from then on no older core can commit, whatever the proof will say.
"""

import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Final, assert_never

import msgspec
from sqlalchemy import Connection
from sqlalchemy.exc import DBAPIError

from core import departure
from core.departure import Departure
from core.guarded.beacon import Beacon
from core.guarded.recorder import FlightRecorder
from core.journal import ballast, disk, schema
from core.journal.ahead import Ahead
from core.journal.append import Journal
from core.journal.backup import BACKUPS, back_up
from core.journal.chain import Broken, EventRow
from core.journal.fence import BringUp, Fenced, FenceOutcome, NotKept, NotOurs, Raised, StoreWentBack, fence
from core.journal.ground import Ground
from core.journal.lock import DoorClosed, StartGuard, take_start_guard
from core.journal.proof import Proven, Witness, prove
from core.journal.rebuilding import Rebuilding
from core.journal.room import Room
from core.journal.store import (
    LEDGER_FILE,
    StoreError,
    StoreFault,
    Writing,
    begin_reading,
    close_writing,
    end_holders,
    is_in_server,
    size_bytes,
    store_error,
    take_seat,
    wait_at_most,
    watch,
    writing,
)
from core.rulings import Rulings
from core.settings import Settings

#: What is about a lock or a server, whatever the data folder's disk says.
_NOT_THE_DISKS: Final = frozenset({StoreFault.BUSY, StoreFault.AWAY, StoreFault.UNFIT})
ASK_EVERY_S: Final = 1.0
MORE_TIME_USEC: Final = 5_000_000  # several times that, so one lost asking does not end a start


class OpenBook(msgspec.Struct, frozen=True):
    """A proven book that this core, and no other, may write to."""

    journal: Journal
    epoch: int
    proof: Proven
    guard: StartGuard


class Telling(msgspec.Struct, frozen=True):
    """Whom to tell while the book is being opened."""

    recorder: FlightRecorder
    beacon: Beacon


class Terms(msgspec.Struct, frozen=True):
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
    data: Path,
    terms: Terms,
    settings: Settings,
    telling: Telling,
    ahead: Ahead | None = None,
    engine: Writing | None = None,
    rulings: Rulings | None = None,
    ground: Ground | None = None,
) -> OpenBook | Departure:
    """Take the book of a data folder over, raising its epoch, and prove its tail. Blocks.

    `ahead`: what this very process has seen of the chain already. It is at its end with this. `engine`: the one to
    write with, where it was tried before. `rulings`: absent, there are none. `ground`: from where the tail is proven,
    where nothing was seen ahead.
    """
    rulings = rulings or Rulings()
    guard = take_start_guard(data, shared=terms.shared)
    if isinstance(guard, DoorClosed):
        return _not_let_in(guard)
    engine = engine or writing(settings.ledger(data))
    taken = _take_over(engine, data, terms, settings, telling)
    if isinstance(taken, StoreError) and taken.fault is StoreFault.NO_ROOM and ballast.drop(data):
        taken = _take_over(engine, data, terms, settings, telling)
    if isinstance(taken, StoreError):
        return _untaken(taken, telling)
    if isinstance(taken, Departure):
        return taken
    connection = taken.connection
    rebuilding = rulings.rebuilding
    ahead = ahead or Ahead(settings.tail_events, rebuilding, ground)
    proof = _prove(connection, terms, ahead, telling, rebuilding)
    if isinstance(proof, StoreError):
        return _unproven(proof, data)
    if isinstance(proof, Departure):
        return proof
    wait_at_most(connection, settings.write_busy_ms)
    room = Room(None if is_in_server(connection) else data, time.monotonic_ns)
    journal = Journal(
        connection,
        taken.epoch,
        proof.head_seq,
        telling.recorder,
        room,
        time.time_ns,
        rulings.quarantine,
        rulings.armoury,
    )
    return OpenBook(journal, taken.epoch, proof, guard)


def _not_let_in(door: DoorClosed) -> Departure:
    """A lock that a disk refuses is the disk's doing and no mistake in a setting."""
    error = disk.refused(door.number)
    return departure.config_invalid(door.sentence) if error is None else _of_store(error)


class _Taken(msgspec.Struct, frozen=True):
    connection: Connection
    epoch: int


def _take_over(
    engine: Writing, data: Path, terms: Terms, settings: Settings, telling: Telling
) -> _Taken | StoreError | Departure:
    busy_ms = settings.fence_busy_ms if terms.busy_ms is None else terms.busy_ms
    connection = engine.connect(busy_ms)
    if isinstance(connection, StoreError):
        return _as_the_disk_says(connection, data)
    outcome: FenceOutcome | None = take_seat(connection, shared=terms.shared)
    if outcome is None:
        outcome = fence(connection, terms.expected_epoch, _bringing_up(data, telling))
        if _is_busy(outcome) and terms.shared and end_holders(connection):
            # The guard has ended whoever served before; a session may outlive it, and a frozen one never lets go.
            outcome = fence(connection, terms.expected_epoch, _bringing_up(data, telling))
    if isinstance(outcome, Raised):
        telling.recorder.set_epoch(outcome.epoch)
        telling.beacon.epoch_raised(outcome.epoch)
        return _Taken(connection, outcome.epoch)
    if isinstance(outcome, StoreError):
        found = _as_the_disk_says(outcome, data)
        if found.fault is StoreFault.NO_ROOM:
            close_writing(connection)  # nothing of it went through, and the room may be found
        return found
    return _turned_away(outcome, terms.expected_epoch)


def _is_busy(outcome: FenceOutcome) -> bool:
    return isinstance(outcome, StoreError) and outcome.fault is StoreFault.BUSY


def _bringing_up(data: Path, telling: Telling) -> BringUp:
    def bring_up(connection: Connection, version: int, epoch: int) -> StoreError | None:
        asking = AskingForTime(telling.beacon.extend, time.monotonic)
        step_bytes = schema.bring_up_bytes(connection, version)
        error = back_up(data / LEDGER_FILE, version, epoch, size_bytes(connection), step_bytes, asking.tick)
        if error is None:
            watch(connection, asking.tick)
            schema.bring_up(connection, version)
            watch(connection, None)
        return error

    return bring_up


def _turned_away(outcome: Fenced | StoreWentBack | NotOurs | NotKept, expected: int | None) -> Departure:
    match outcome:
        case Fenced(actual):
            return departure.fenced(expected or 0, actual)
        case StoreWentBack(actual, wanted):
            return departure.corrupt(f"it stands at epoch {actual}, but epoch {wanted} had been raised")
        case NotOurs(None):
            return departure.config_invalid(
                f"{LEDGER_FILE} is a database of something else: choose another folder."
            )
        case NotOurs(int(version)) if version > schema.SCHEMA_VERSION:
            return departure.config_invalid(
                f"{LEDGER_FILE} has schema {version}, made by a newer version of this program, and this one knows"
                f" {schema.SCHEMA_VERSION}: start that version again. Nothing was changed."
            )
        case NotOurs(version):
            return departure.config_invalid(
                f"{LEDGER_FILE} has schema {version}, older than {schema.SCHEMA_VERSION_OLDEST}, the oldest that this"
                " version takes along: bring it up with a version between the two. Nothing was changed."
            )
        case NotKept(version, error):
            return _unkept(version, error)
        case _:
            assert_never(outcome)


def _unkept(version: int, error: StoreError) -> Departure:
    """A ledger that can't be copied is not changed either."""
    text = (
        f"no copy of it could be kept before it is brought from schema {version} to {schema.SCHEMA_VERSION}, and"
        f" nothing was changed; {error.text}"
    )
    if error.fault in {StoreFault.NO_ROOM, StoreFault.READ_ONLY, StoreFault.DAMAGED}:
        return _of_store(StoreError(error.fault, text))
    return departure.config_invalid(
        f"The ledger can't be brought up: {text}. See that the folder {BACKUPS} in its data folder can be written to."
    )


def _prove(
    connection: Connection, terms: Terms, ahead: Ahead, telling: Telling, rebuilding: Rebuilding
) -> Proven | StoreError | Departure:
    # A witness of nothing (a predecessor that committed nothing) is nobody's word about any event.
    witnesses = [witness for witness in terms.witnesses if witness.seq > 0]
    try:
        begin_reading(connection)
        tail = ahead.tail(connection, witnesses)
        if isinstance(tail, Broken):
            return departure.corrupt(tail.sentence)
        asking = AskingForTime(telling.beacon.extend, time.monotonic)
        proof = prove(msgspec.structs.replace(tail, rows=asking.over(rebuilding.over(tail.rows))), witnesses)
        connection.exec_driver_sql("ROLLBACK").close()
    except DBAPIError as error:
        return store_error(error)
    return departure.corrupt(proof.sentence) if isinstance(proof, Broken) else proof


class AskingForTime:
    """While something long makes progress, the guard is asked for more time to start in."""

    def __init__(self, extend: Callable[[int], None], now_s: Callable[[], float]) -> None:
        """Begin; nobody is asked within the first `ASK_EVERY_S`. `extend` takes microseconds."""
        self._extend = extend
        self._now_s = now_s
        self._asked_s = now_s()

    def tick(self) -> None:
        """Say that there is progress; as often as one likes."""
        if self._now_s() - self._asked_s >= ASK_EVERY_S:
            self._asked_s = self._now_s()
            self._extend(MORE_TIME_USEC)

    def over(self, rows: Iterable[EventRow]) -> Iterator[EventRow]:
        """Pass events on; each of them is progress."""
        for row in rows:
            self.tick()
            yield row


def _as_the_disk_says(error: StoreError, data: Path) -> StoreError:
    # What it says of a disk that takes no writes depends on where it met that: the disk itself is asked first.
    return error if error.fault in _NOT_THE_DISKS else disk.refusal(data) or error


def _untaken(error: StoreError, telling: Telling) -> Departure:
    if error.fault is StoreFault.BUSY:
        telling.beacon.fence_blocked()
    return _of_store(error)


def _unproven(error: StoreError, data: Path) -> Departure:
    if error.fault in _NOT_THE_DISKS:
        return _of_store(error)
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
        case StoreFault.AWAY:
            return departure.away(error.text)
        case StoreFault.UNFIT:
            return departure.unfit(error.text)
        case StoreFault.TAKEN | StoreFault.OTHER:
            return departure.commit_failed(error.text)
