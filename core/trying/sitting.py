"""`python -m core try`: from a docket's file to the last line, in a process that stays small and has one thread.

It loads everything, reads the docket, clears away what the dead have left, copies the ledger, and then only watches. It
runs at a low priority, and so does whatever it starts: somebody is being served meanwhile. A TERM is an exception here, so that
wherever it comes the cores are ended and the folder is removed. Not chosen: an event loop; it could not be forked out of.
"""

import gc
import json
import os
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Any, Final, NoReturn

import msgspec
import psutil

from core.departure import ExitCode
from core.guarded.poison import FILE as DRILL_FILE
from core.guarded.poison import FILE_BYTES_MAX as DRILL_BYTES_MAX
from core.guarded.quarantine import FILE_BYTES_MAX as RULES_BYTES_MAX
from core.guarded.quarantine import VERSION as RULES_VERSION
from core.guarded.quarantine import read_small
from core.imports.reading.formats import builtin_formats
from core.journal import disk
from core.journal.store import StoreError, StoreFault, has_ledger
from core.loading import NICE
from core.rulings import RULES
from core.saying import say
from core.settings import Settings
from core.trying.copying import Copy, TooLarge, copy_into
from core.trying.court import Court
from core.trying.docket import DOCKET_BYTES_MAX, Docket, Request, read_docket
from core.trying.place import Place, clear_up, take_place
from core.trying.verdicts import Verdict, untried
from core.web.rehearsal import load

API: Final = "/api/"  # below it nobody is shown a page
TERMINATED: Final = 128 + signal.SIGTERM


class _TermError(BaseException):
    """TERM came: no handler of an ordinary error may take it for one."""


def sit(data: Path, docket_file: Path, settings: Settings) -> int:
    """Try the cases of a docket on a copy of a data folder's ledger; return the exit code."""
    signal.signal(signal.SIGTERM, _on_term)
    signal.signal(signal.SIGINT, _on_term)
    be_quiet()
    docket = _docket(docket_file)
    if isinstance(docket, str):
        say(docket)
        return ExitCode.CONFIG_INVALID
    if not has_ledger(settings.ledger(data), settings.fence_busy_ms):
        say(f"There is no ledger in {data}: name its folder with --data.")
        return ExitCode.CONFIG_INVALID
    try:
        clear_up(data)
        place = take_place(data)
    except OSError as error:
        say(f"There is no place for a trial in {data}: {error.strerror}.")
        return ExitCode.DISK_FULL
    try:
        return _sit_in(place, data, docket, settings)
    except (_TermError, BrokenPipeError):  # the latter: whoever asked is gone
        return TERMINATED
    except OSError as error:
        say(f"The trial could not be brought to its end: {error.strerror}.")
        return _code_of(disk.refused(error.errno or 0))
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # once is enough: what is left is to clear away
        place.remove()


def be_quiet() -> None:
    """Give way to whoever serves: a low priority, and the disk only when nobody else wants it."""
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, max(NICE, os.getpriority(os.PRIO_PROCESS, 0)))
    with suppress(psutil.Error, OSError):
        psutil.Process().ionice(psutil.IOPRIO_CLASS_IDLE)


def _sit_in(place: Place, data: Path, docket: Docket, settings: Settings) -> int:
    begun_ns = time.monotonic_ns()
    copy = copy_into(place.path, settings.ledger(data), docket.copy_bytes_max, lambda: None)
    if isinstance(copy, TooLarge):
        why = f"the ledger has {copy.size_bytes} bytes, and {docket.copy_bytes_max} may be copied"
        _leave_untried(docket, why)
        return ExitCode.ASKED
    if isinstance(copy, StoreError):
        say(f"The ledger could not be copied: {copy.text}.")
        return _code_of(copy)
    _tell({"type": "copied", "seq": copy.seq, "ms": (time.monotonic_ns() - begun_ns) // 1_000_000})
    _court(place, data, docket, copy, settings).sit()
    _tell({"type": "over"})
    return ExitCode.ASKED


def _code_of(error: StoreError | None) -> ExitCode:
    full = error is not None and error.fault in {StoreFault.NO_ROOM, StoreFault.READ_ONLY}
    return ExitCode.DISK_FULL if full else ExitCode.COMMIT_FAILED


def _court(place: Place, data: Path, docket: Docket, copy: Copy, settings: Settings) -> Court:
    rulings = _bring_rulings(data / RULES, place.path / RULES)
    _load(docket)
    gc.freeze()  # what is loaded is every core's: none shall copy its pages to look for garbage
    os.chdir(place.path)  # a socket's path may have 107 bytes, and a data folder's more
    memory_bytes = docket.memory_bytes or psutil.virtual_memory().available // 2
    return Court(docket, data, place.path, rulings, copy, memory_bytes, settings, _tell)


def _load(docket: Docket) -> None:
    """Load what is otherwise loaded at its first use, in each core anew; pages only where one may have to be drawn."""
    builtin_formats()
    requests = (case.tried for case in docket.cases if isinstance(case.tried, Request))
    if any(not request.path.startswith(API) for request in requests):
        load()


def _docket(path: Path) -> Docket | str:
    raw = read_small(path, DOCKET_BYTES_MAX)
    if raw is None:
        return f"There is no docket at {path}."
    return read_docket(raw) if isinstance(raw, bytes) else f"The docket can't be read: {raw.why}"


def _bring_rulings(rules: Path, into: Path) -> Path:
    """Bring what is armed, and of the rules which events are left out; return where the rules lie then."""
    into.parent.mkdir(mode=0o700)
    armed = read_small(rules.with_name(DRILL_FILE), DRILL_BYTES_MAX)
    if isinstance(armed, bytes):
        into.with_name(DRILL_FILE).write_bytes(armed)
    kept = _parked(read_small(rules, RULES_BYTES_MAX))
    into.write_text(json.dumps({"version": RULES_VERSION, "serial": 0, "rules": kept}))
    return into


def _parked(raw: object) -> list[Any]:
    """Return the rules that hold in a trial too; none where there are none, or none that can be read."""
    try:
        said = json.loads(raw) if isinstance(raw, bytes) else {}
        return [rule for rule in said["rules"] if rule["type"] == "parked"]
    except (ValueError, RecursionError, TypeError, KeyError):
        return []


def _leave_untried(docket: Docket, why: str) -> None:
    for case in docket.cases:
        _tell(untried(case.name, why))
    _tell({"type": "over"})


def _tell(line: dict[str, Any] | Verdict) -> None:
    sys.stdout.buffer.write(msgspec.json.encode(line) + b"\n")
    sys.stdout.buffer.flush()


def _on_term(_number: int, _frame: FrameType | None) -> NoReturn:
    raise _TermError
