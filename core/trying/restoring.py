"""`python -m core rehearse-restore`: whether a backup could be gone back to, found out on a day when nobody needs it.

A copy of the ledger as it stands, and the newest backup (without one: the newest copy that was kept before a change of
schema), are each put into a folder of their own and opened as a restore would open them: brought up to the present schema, fenced, proven before serving, then
proven whole from the first event. The event that the copy ended with must be there under its hash. Whatever is found, the
ledger and the backups themselves are only read. Not chosen: to trust a check of the file; a database can be whole and the
book in it not.
"""

import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

import click
import msgspec

from core.departure import Departure, ExitCode
from core.guarded.quarantine import Quarantine
from core.guarded.recorder import NoRecorder
from core.journal.backup import BACKUPS, newest_backup
from core.journal.store import LEDGER_FILE, StoreError, StoreFault, Whereabouts, has_ledger, open_reading
from core.journal.verify import SLICE_EVENTS, GivenUp, Verdict, verify
from core.keeping.shelf import newest
from core.rulings import RULES, Rulings
from core.saying import say
from core.settings import Settings
from core.trying.copying import Copy, TooLarge, copy_into
from core.trying.life import open_copy
from core.trying.place import clear_up, take_place
from core.trying.sitting import be_quiet

BYTES_MAX: Final = 1 << 50  # whatever has room may be rehearsed
READ_MS_MAX: Final = 60_000  # for a slice of a copy that nobody writes to


class Report(msgspec.Struct, frozen=True):
    """What came of it: `events` and `head` (hash) of the fresh copy, `backup`: the kept one that was restored too.

    `fault`: what is wrong, or stood in the way; None where all is well.
    """

    ok: bool
    events: int
    head: str
    took_ms: int
    backup: str | None
    fault: str | None


def _newest_kept(data: Path) -> Path | None:
    """Return the newest proven copy in the folder of backups; None without one."""
    with suppress(OSError):
        name = newest(path.name for path in (data / BACKUPS).iterdir())
        return None if name is None else data / BACKUPS / name
    return None


class _Failed(msgspec.Struct, frozen=True):
    code: ExitCode
    sentence: str


def rehearse(data: Path, settings: Settings, *, as_json: bool) -> int:
    """Restore and prove, tell what came of it, and return the exit code."""
    be_quiet()
    begun_ns = time.monotonic_ns()
    kept = _newest_kept(data) or newest_backup(data)
    found: Verdict | _Failed = _restored(data, settings.ledger(data), settings, "the ledger as it stands")
    whole = found
    if isinstance(found, Verdict) and kept is not None:
        whole = _restored(data, kept, settings, kept.name)
    failed = whole if isinstance(whole, _Failed) else None
    report = Report(
        ok=failed is None,
        events=found.events if isinstance(found, Verdict) else 0,
        head=found.head if isinstance(found, Verdict) else "",
        took_ms=(time.monotonic_ns() - begun_ns) // 1_000_000,
        backup=kept.name if kept is not None else None,
        fault=None if failed is None else failed.sentence,
    )
    _tell(report, as_json=as_json)
    return ExitCode.ASKED if failed is None else failed.code


def _tell(report: Report, *, as_json: bool) -> None:
    if as_json:
        click.echo(msgspec.json.encode(report).decode())
    elif report.ok:
        kept = f", and so does the kept {report.backup}" if report.backup is not None else ""
        click.echo(
            f"A copy of the ledger opens and is whole: {report.events} events, head {report.head}{kept}."
        )
    else:
        say(f"The restore would fail: {report.fault}")


def _restored(data: Path, source: Whereabouts, settings: Settings, called: str) -> Verdict | _Failed:
    """Restore one copy into a folder of its own and prove it; nothing is left of it."""
    if not has_ledger(settings.ledger(data), settings.fence_busy_ms):
        return _Failed(ExitCode.CONFIG_INVALID, f"There is no ledger in {data}: name its folder with --data.")
    try:
        clear_up(data)
        place = take_place(data)
    except OSError as error:
        return _Failed(ExitCode.DISK_FULL, f"There is no place for a copy in {data}: {error.strerror}.")
    try:
        _progress(f"Copying {called} …")
        copy = copy_into(place.path, source, BYTES_MAX, lambda: None)
        if isinstance(copy, StoreError):
            full = copy.fault is StoreFault.NO_ROOM
            code = ExitCode.DISK_FULL if full else ExitCode.STORE_CORRUPT
            return _Failed(code, f"{called} can't be copied ({copy.text}).")
        assert not isinstance(copy, TooLarge), "no disk has so much"
        return _proven(data, place.path, copy, settings, called)
    finally:
        place.remove()


def _proven(data: Path, folder: Path, copy: Copy, settings: Settings, called: str) -> Verdict | _Failed:
    # What is left out of the household's ledger is left out here; what a drill has armed would only kill this process.
    rulings = Rulings(Quarantine(data / RULES))
    rulings.read()
    book = open_copy(folder, settings, rulings, NoRecorder())
    if isinstance(book, Departure):
        return _Failed(book.code, f"{called}: {book.sentence}")
    book.journal.close()
    book.guard.release()
    readers = open_reading(folder / LEDGER_FILE, 1, settings.fence_busy_ms)
    try:
        verdict = verify(readers, READ_MS_MAX, _counting(copy.seq, called), rulings.rebuilding)
    finally:
        readers.dispose()
    _progress("")
    assert not isinstance(verdict, GivenUp), "nobody asks this process to leave"
    if isinstance(verdict, StoreError):
        return _Failed(ExitCode.STORE_CORRUPT, f"{called} can't be read ({verdict.text}).")
    if not verdict.ok:
        return _Failed(ExitCode.STORE_CORRUPT, f"{called} is not whole: {verdict.reason}.")
    if (verdict.events, verdict.head) != (copy.seq, copy.hash.hex()):
        return _Failed(
            ExitCode.STORE_CORRUPT, f"{called} does not end with the event that it says it ends with."
        )
    return verdict


def _counting(events: int, called: str) -> Callable[[], bool]:
    """Return what is asked between two slices: it says how far the proof is, and never that it is to be given up."""
    slices = 0

    def between() -> bool:
        nonlocal slices
        seen = min(slices * SLICE_EVENTS, events)
        _progress(f"Proving {called}: {100 * seen // max(1, events)} % of {events} events …")
        slices += 1
        return False

    return between


def _progress(text: str) -> None:
    if sys.stderr.isatty():
        sys.stderr.write(f"\r\x1b[K{text}")
        sys.stderr.flush()
