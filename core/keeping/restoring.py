"""Going back to a copy: into a folder that holds no ledger, proven before it gets the ledger's name.

The copy itself is only read. What is laid down is proven from its first event, and the ledger's name is the last thing it is
given; whoever dies on the way leaves a folder without a ledger, and the same words again bring it about. A copy of an older
schema is first brought up as a start would do it. The epoch stays that of the copy: the core that begins to write raises it,
as ever. Nothing is ever written over: going back beside a ledger that lives would make two histories of one household.
"""

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, Final

import msgspec

from core.departure import Departure
from core.guarded.recorder import NoRecorder
from core.journal import disk, schema
from core.journal.backup import flush
from core.journal.log_lines import LINE_BYTES_MAX
from core.journal.log_out import Unusable, take_in
from core.journal.room import ROOM_BYTES_MIN, free_bytes
from core.journal.store import StoreError, StoreFault, copy_beside_work, settle
from core.keeping.making import Told, prove
from core.keeping.shelf import SUFFIX, Note
from core.rulings import RULES, Rulings
from core.settings import Settings
from core.trying.life import open_copy

PLACE: Final = ".restoring"


class NotRestored(msgspec.Struct, frozen=True):
    """Nothing was changed: why, in a sentence that says the next step."""

    sentence: str


def restore(copy: Path, data: Path, ledger_name: str, settings: Settings, told: Told) -> Note | NotRestored:
    """Lay a copy down as the ledger of a folder, and return what it holds. Blocks, for minutes perhaps."""
    return _in_place(copy, data, ledger_name, lambda target: _restored(copy, data, target, settings, told))


def restore_log(log: Path, data: Path, ledger_name: str, told: Told) -> Note | NotRestored:
    """Make the ledger of a folder out of a whole log, and return what it holds. Blocks, for minutes perhaps."""
    return _in_place(log, data, ledger_name, lambda target: _taken_in(log, data, target, told))


def _in_place(
    source: Path, data: Path, ledger_name: str, make: Callable[[Path], Note | NotRestored]
) -> Note | NotRestored:
    """Have a ledger made in a place of its own within a folder that has none; nothing else of it is left."""
    refused = _refusal(source, data, ledger_name)
    if refused is not None:
        return refused
    place = data / PLACE
    try:
        data.mkdir(mode=0o700, parents=True, exist_ok=True)
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(mode=0o700)
        try:
            return make(place / ledger_name)
        finally:
            shutil.rmtree(place, ignore_errors=True)
    except OSError as error:
        full = disk.refused(error.errno or 0) is not None
        step = "free some room" if full else "choose another folder with --data"
        return NotRestored(f"{data} does not take a ledger ({error.strerror}): {step}.")


def _refusal(copy: Path, data: Path, ledger_name: str) -> NotRestored | None:
    if not copy.is_file():
        return NotRestored(f"There is no file {copy}: name a backup, such as one in DATA/backups, or a log.")
    if (data / ledger_name).exists() or (data / RULES).exists():
        return NotRestored(
            f"There is a ledger in {data}, and nothing is written over it: give an empty folder with --data, or move"
            " this one aside first."
        )
    return None


def _restored(copy: Path, data: Path, target: Path, settings: Settings, told: Told) -> Note | NotRestored:
    has_bytes = copy.stat().st_size
    free = free_bytes(os.statvfs(data), reserve_is_ours=False)
    if free is not None and free < has_bytes + ROOM_BYTES_MIN:
        return NotRestored(f"There is no room in {data}: it takes {has_bytes} bytes and {free} are free.")
    told("copying", None)
    error = copy_beside_work(copy, target, lambda: told("copying", None)) or settle(target)
    if error is not None:
        if error.fault is StoreFault.DAMAGED:
            return NotRestored(
                f"{copy} is no ledger, or a damaged one ({error.text}): choose another backup."
            )
        return NotRestored(f"{copy} could not be copied ({error.text}).")
    rules = _rules_beside(copy)
    rulings = _with_rules(target.parent, rules)
    found = prove(target, rulings.rebuilding, told)
    if (isinstance(found, Note) and found.schema < schema.SCHEMA_VERSION) or isinstance(found, str):
        # An older one is proven as what it becomes: the readings that it lacks are made on the way.
        brought_up = open_copy(target.parent, settings, rulings, NoRecorder())
        if isinstance(brought_up, Departure):
            return NotRestored(f"{copy} can't be gone back to: {brought_up.sentence}")
        brought_up.journal.close()
        brought_up.guard.release()
        settle(target)
        found = prove(target, rulings.rebuilding, told)
    if isinstance(found, str):
        return NotRestored(f"{copy} can't be gone back to: {found}. Choose another backup.")
    _lay_down(target, data, rules)
    return found


def _taken_in(log: Path, data: Path, target: Path, told: Told) -> Note | NotRestored:
    with log.open("rb") as lines:
        made = take_in(_bounded(lines), target, lambda seq, of: told("taking", 100 * seq // max(1, of)))
    if isinstance(made, StoreError):
        return NotRestored(f"The ledger could not be written ({made.text}).")
    if isinstance(made, Unusable):
        where = f"line {made.line} of {log}" if made.line else str(log)
        return NotRestored(f"Nothing was taken in: {where}: {made.why}. Export the log once more.")
    found = prove(target, Rulings().rebuilding, told)
    if isinstance(found, str):
        return NotRestored(f"Nothing was taken in: what came of {log} does not hold: {found}.")
    _lay_down(target, data, None)
    return found


def _bounded(lines: IO[bytes]) -> Iterator[bytes]:
    """Give the lines of a file, none longer than one may be: a stranger's file may have no end of line at all."""
    while line := lines.readline(LINE_BYTES_MAX):
        yield line


def _rules_beside(copy: Path) -> str | None:
    """Return the guard's rules that were in force when the copy was made: what it leaves out stays left out."""
    with suppress(OSError, msgspec.DecodeError):
        return msgspec.json.decode((copy.parent / (copy.name + SUFFIX)).read_bytes(), type=Note).rules
    return None


def _with_rules(folder: Path, rules: str | None) -> Rulings:
    if rules is None:
        return Rulings()
    path = folder / RULES
    path.parent.mkdir(mode=0o700, parents=True)
    path.write_text(rules, encoding="utf-8")
    rulings = Rulings.beside(path)
    rulings.read()
    return rulings


def _lay_down(target: Path, data: Path, rules: str | None) -> None:
    """Give what was proven its place: the rules first, the ledger's name last."""
    flush(target)
    if rules is not None:
        (data / RULES).parent.mkdir(mode=0o700, exist_ok=True)
        (target.parent / RULES).replace(data / RULES)
        flush((data / RULES).parent)
    target.replace(data / target.name)
    flush(data)
