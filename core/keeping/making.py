"""Making a copy: beside the core that writes, proven whole, and only then given its name.

SQLite's own backup copies what is committed at one moment while others write. The copy is then proven like the ledger itself,
from the first event: a copy that nobody has read is a hope. It is flushed, its note is written beside it, and last of all it
gets its name; whoever dies on the way leaves a `.part` that the next one removes. One at a time, by a lock on the folder.
Not chosen: copying what changed since the last one. It would save minutes a day and make every copy depend on all
before it.
"""

import datetime as dt
import fcntl
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from hashlib import file_digest
from pathlib import Path
from typing import Final

import msgspec

from core.guarded.quarantine import FILE_BYTES_MAX, read_small
from core.journal import ballast, disk, queries
from core.journal.backup import BACKUPS, flush
from core.journal.carrying import copy_now
from core.journal.rebuilding import Rebuilding
from core.journal.room import free_bytes
from core.journal.store import (
    StoreError,
    StoreFault,
    Whereabouts,
    open_reading,
    settle,
    size_bytes,
    snapshot,
)
from core.journal.verify import SLICE_EVENTS, GivenUp, Verdict, verify
from core.keeping.shelf import SUFFIX, Note, name_of, superfluous
from core.rulings import Rulings

FOLDER: Final = BACKUPS
PART: Final = ".kept.part"  # the end of a name under which a copy is made
READ_MS_MAX: Final = 60_000  # for a slice of a copy that nobody writes to
BUSY_MS: Final = 5_000

#: Told how far it is: what is being done, and how much of it in percent (None: nobody knows).
Told = Callable[[str, int | None], object]


class NotMade(msgspec.Struct, frozen=True):
    """No copy was made: why, in a sentence that says the next step. `full`: for want of room. `busy`: another is being made."""

    sentence: str
    full: bool = False
    busy: bool = False


def make(
    ledger: Whereabouts, folder: Path, keep: int, rulings: Rulings, rules: Path, now: dt.datetime, told: Told
) -> tuple[Path, Note] | NotMade:
    """Make a proven copy of a ledger in a folder, and remove the oldest beyond `keep`. Blocks, for minutes perhaps.

    `rulings` and `rules`: what is left out of this ledger, and the file that says so.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with _alone_in(folder) as alone:
            if not alone:
                return NotMade(
                    f"Another backup is being made in {folder}: wait for it, then look there.", busy=True
                )
            part = folder / f"{os.getpid()}{PART}"
            try:
                return _made(ledger, part, keep, rulings, rules, now, told)
            finally:
                _clear_up(folder)
    except OSError as error:
        full = disk.refused(error.errno or 0) is not None
        step = (
            "free some room, or name another folder with --to" if full else "choose another folder with --to"
        )
        return NotMade(f"{folder} does not take a copy ({error.strerror}): {step}.", full=full)


def _made(
    ledger: Whereabouts, part: Path, keep: int, rulings: Rulings, rules: Path, now: dt.datetime, told: Told
) -> tuple[Path, Note] | NotMade:
    _clear_up(part.parent)
    has_bytes = _bytes_of(ledger)
    free = free_bytes(os.statvfs(part.parent), reserve_is_ours=False)
    if free is not None and free < has_bytes + ballast.ROOM_BYTES:
        return NotMade(
            f"There is no room in {part.parent}: a copy takes {has_bytes} bytes and {free} are free. Free some, or name"
            " another folder with --to.",
            full=True,
        )
    told("copying", None)
    os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600))
    error = copy_now(ledger, part, lambda: told("copying", None)) or settle(part)
    if error is not None:
        return NotMade(
            f"The ledger could not be copied ({error.text}).", full=error.fault is StoreFault.NO_ROOM
        )
    note = prove(part, rulings.rebuilding, told)
    if isinstance(note, str):
        return NotMade(f"The copy is not kept: {note}. Run hardcore verify.")
    name = name_of(now, note.events)
    note = msgspec.structs.replace(
        note, file=name, proven_at=now.astimezone(dt.UTC).isoformat(), rules=_rules(rulings, rules)
    )
    _name(part, note)
    for old in superfluous((path.name for path in part.parent.iterdir()), keep):
        (part.parent / old).unlink(missing_ok=True)
        (part.parent / (old + SUFFIX)).unlink(missing_ok=True)
    return part.with_name(name), note


def _rules(rulings: Rulings, rules: Path) -> str | None:
    """Return the guard's rules where they leave an event out: without them the copy could not be rebuilt."""
    if not rulings.quarantine.rules.parked:
        return None
    read = read_small(rules, FILE_BYTES_MAX)
    return read.decode("utf-8", "replace") if isinstance(read, bytes) else None


def prove(copy: Path, rebuilding: Rebuilding, told: Told) -> Note | str:
    """Prove a copy that nobody writes to, from its first event; return what is known of it, or what is wrong."""
    readers = open_reading(copy, 1, BUSY_MS, alone=True)
    try:
        with snapshot(readers, READ_MS_MAX) as connection:
            head = queries.head(connection)
            bytes_now = size_bytes(connection)
        verdict: Verdict | StoreError | GivenUp = verify(
            readers, READ_MS_MAX, _counting(head.head_seq, told), rebuilding
        )
    finally:
        readers.dispose()
    assert not isinstance(verdict, GivenUp), "nobody asks this process to leave"
    if isinstance(verdict, StoreError):
        return f"it can't be read ({verdict.text})"
    if not verdict.ok:
        return f"it is not whole ({verdict.reason})"
    with copy.open("rb") as file:
        digest = file_digest(file, "sha256").hexdigest()
    return Note(
        copy.name,
        "",
        verdict.events,
        verdict.head,
        head.epoch,
        head.schema_version,
        bytes_now,
        digest,
        verdict.trial_balance,
    )


def _bytes_of(ledger: Whereabouts) -> int:
    readers = open_reading(ledger, 1, BUSY_MS)
    try:
        with snapshot(readers, READ_MS_MAX) as connection:
            return size_bytes(connection)
    finally:
        readers.dispose()


def _counting(events: int, told: Told) -> Callable[[], bool]:
    slices = 0

    def between() -> bool:
        nonlocal slices
        told("proving", min(100, 100 * slices * SLICE_EVENTS // max(1, events)))
        slices += 1
        return False

    return between


def _name(part: Path, note: Note) -> None:
    """Flush a copy, write its note, and give both their names: the note last, because it says that there is a copy."""
    folder = part.parent
    flush(part)
    noted = part.with_name(f"{part.name}{SUFFIX}")
    descriptor = os.open(noted, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
    with os.fdopen(descriptor, "wb") as file:
        file.write(msgspec.json.format(msgspec.json.encode(note)))
        file.flush()
        os.fsync(file.fileno())
    part.replace(folder / note.file)
    noted.replace(folder / (note.file + SUFFIX))
    flush(folder)


def _clear_up(folder: Path) -> None:
    """Remove what a death has left half-way, and what SQLite laid beside it: nobody else is at work in this folder."""
    with suppress(OSError):
        for left in folder.glob(f"*{PART}*"):
            left.unlink(missing_ok=True)


@contextmanager
def _alone_in(folder: Path) -> Iterator[bool]:
    """Hold a folder's lock for as long as this lasts; False: somebody else has it."""
    lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        yield False
        return
    else:
        yield True
    finally:
        os.close(lock)
