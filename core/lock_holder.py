"""Holds the store's write lock from a process of its own: the other half of the drill `dblock`.

What it makes is the real fault, a backup program or a forgotten shell that has the ledger open in a transaction,
seen by the core and by its guard as they would see that one. It writes nothing: its transaction is rolled back,
and it leaves without closing the store, because the last one to close a store empties its log. The kernel takes
the lock back. The time has an end, so a drill whose guard died is over by itself.
"""

import signal
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Final

from core import departure
from core.departure import Departure
from core.journal.store import LEDGER_FILE

SECONDS_MAX: Final = 600
_ENDS: Final = frozenset({signal.SIGTERM, signal.SIGINT})


def hold_lock(data: Path, seconds: int, busy_ms: int, say: Callable[[str], None]) -> Departure | None:
    """Take the lock, `say` so in one line, and let go after `seconds` or at a TERM; return why there was none.

    The process must end by `os._exit` afterwards. TERM is held back from here on, so it can't come too early.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, _ENDS)
    path = data / LEDGER_FILE
    if not path.is_file():
        return departure.config_invalid(f"There is no ledger in {data}: name its folder with --data.")
    try:
        store = sqlite3.connect(
            f"{path.absolute().as_uri()}?mode=rw", uri=True, timeout=busy_ms / 1000, isolation_level=None
        )
        store.execute("BEGIN IMMEDIATE").close()
        store.execute("SELECT epoch FROM meta").close()
    except sqlite3.Error as error:
        return _not_held(path, error)
    say(f"Holding the write lock of {path} for {seconds} s.")
    signal.sigtimedwait(_ENDS, seconds)
    store.execute("ROLLBACK").close()
    return None


def _not_held(path: Path, error: sqlite3.Error) -> Departure:
    if getattr(error, "sqlite_errorcode", 0) == sqlite3.SQLITE_BUSY:
        return departure.locked(str(error))
    return departure.config_invalid(
        f"{path} can't be locked ({error}): it must be a ledger that can be written."
    )
