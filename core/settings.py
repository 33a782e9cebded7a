"""What can be set about a core: one declaration each, read from the environment, judged together.

Paths and orders come from the guard (`docs/wires.md` section 1) and are not settings. These are the limits and
waiting times of the core itself, each with unit, default and bounds; `CORE_<NAME>` in the environment sets
one, which is how a test shortens a wait. A configuration file of the core's own was not chosen: the guard's
policy is the file that people edit, and a core run by hand is a moment's affair.
"""

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Final

import msgspec

from core.journal.store import LEDGER_FILE, Server, Whereabouts, server_at
from core.journal.stores.postgresql import DRIVER, EXTRA
from core.store_file import STORE_FILE, stored_address

#: Where the ledger lies, if it is no file: an address that may hold a password, and is shown to nobody.
STORE: Final = "CORE_STORE"
_PREFIX: Final = "CORE_"
_DIGITS_MAX: Final = 12


class _Bounds(msgspec.Struct, frozen=True):
    least: int
    most: int
    text: str


def _setting(default: int, least: int, most: int, text: str) -> int:
    made: int = field(default=default, metadata={"bounds": _Bounds(least, most, text)})
    return made


@dataclass(frozen=True, slots=True)
class Settings:
    """The limits and waiting times of a core."""

    body_bytes_max: int = _setting(1 << 20, 1 << 10, 1 << 26, "largest body of a request")
    batch_bytes_max: int = _setting(16 << 20, 1 << 10, 1 << 26, "largest body of a batch of transactions")
    fence_busy_ms: int = _setting(2_000, 1, 60_000, "wait for the store's lock at the fence")
    # Shorter than a guard's patience with a core in which nothing gets done: who waits here for somebody
    # else's lock is answered "not done" before a guard could take the wait for a hang.
    write_busy_ms: int = _setting(1_000, 1, 60_000, "wait for the store's lock before a batch")
    command_deadline_ms: int = _setting(
        5_000, 10, 600_000, "time a write may be decided, where no guard says it"
    )
    read_ms_max: int = _setting(900, 10, 10_000, "longest statement of a read")
    readers: int = _setting(2, 1, 16, "connections and threads that read")
    tail_events: int = _setting(1_000, 1, 1_000_000, "events proven before serving when there is no witness")
    # Proof B runs behind the serving: first come the requests that waited for this core.
    verify_after_ms: int = _setting(200, 0, 3_600_000, "rest before the proof of the whole ledger begins")
    verify_rest_ms: int = _setting(20, 0, 10_000, "rest between two slices of that proof")
    verify_again_ms: int = _setting(
        60_000, 10, 3_600_000, "rest before that proof is tried again if the store could not be read"
    )
    # Closing connections and store comes after it, and a guard kills whoever is not gone after its own
    # `stop_timeout_ms` (5,000 unless its policy says otherwise).
    drain_ms: int = _setting(
        3_000,
        10,
        600_000,
        "time to finish what is queued when asked to stop; well below the guard's stop_timeout_ms",
    )
    close_ms: int = _setting(
        1_000,
        10,
        600_000,
        "time to close after a drain that was not complete; with drain_ms below the guard's",
    )
    last_answers_ms: int = _setting(300, 1, 10_000, "time to give the last answers after a failed commit")
    # Imports: what is kept of the files that people gave.
    import_file_bytes_max: int = _setting(20 << 20, 1 << 10, 1 << 28, "largest file of an import")
    import_looking_ms: int = _setting(
        18_000,
        10,
        600_000,
        "time to read a file and look at its rows; well below a gateway's patience of 30 s",
    )
    import_preview_days: int = _setting(7, 1, 3_650, "days until a preview that nobody committed is removed")
    imports_bytes_max: int = _setting(1 << 29, 1 << 20, 1 << 40, "room for all files, the oldest go first")
    imports_max: int = _setting(200, 1, 100_000, "imports kept, the oldest go first")
    ballast_ms: int = _setting(
        60_000, 10, 3_600_000, "rest between two looks whether the room for a fence on a full disk is kept"
    )
    safe_again_ms: int = _setting(
        5_000,
        10,
        3_600_000,
        "rest before a core that serves reads only tries to write again, where no guard tells it to",
    )
    safe_retry_after_s: int = _setting(30, 1, 3_600, "what Retry-After says while only reads are served")
    guards_word_ms: int = _setting(
        2_000,
        0,
        60_000,
        "how long imports and the scheduler wait for the guard to say whom it suspects of the death before",
    )
    schedule_every_ms: int = _setting(
        30_000,
        10,
        3_600_000,
        "rest between two looks at what falls due (recurring items, expiries, the backup)",
    )
    backup_every_h: int = _setting(
        24, 0, 8_760, "hours between two backups that are made by themselves; 0: none"
    )
    backup_after_ms: int = _setting(
        300_000, 0, 86_400_000, "rest of a started core before it makes a backup that is due"
    )
    backup_keep: int = _setting(14, 1, 10_000, "backups kept of those that are made by themselves")
    backup_ms_max: int = _setting(3_600_000, 1_000, 86_400_000, "longest time a backup may take")
    census_ms: int = _setting(60_000, 10, 3_600_000, "rest between two counts of the largest types in memory")
    retry_after_s: int = _setting(1, 1, 3_600, "what Retry-After says")

    store: Server | None = None  # of a server; absent: a file in the data folder

    def ledger(self, data: Path) -> Whereabouts:
        """Return where the ledger of a data folder lies."""
        return self.store or data / LEDGER_FILE

    @classmethod
    def read(cls, environ: Mapping[str, str], data: Path | None = None) -> "Settings | list[str]":
        """Return the settings that `environ` makes, or one sentence for each that is wrong.

        `data`: the folder that says where its ledger lies, where the environment does not.
        """
        values: dict[str, Any] = {}
        faults: list[str] = []
        for declared in fields(cls):
            name = _PREFIX + declared.name.upper()
            text = environ.get(name)
            if text is None or "bounds" not in declared.metadata:
                continue
            bounds: _Bounds = declared.metadata["bounds"]
            if (
                len(text) <= _DIGITS_MAX
                and text.isascii()
                and text.isdigit()
                and bounds.least <= int(text) <= bounds.most
            ):
                values[declared.name] = int(text)
            else:
                faults.append(
                    f"{name} must be a whole number from {bounds.least} to {bounds.most}, not {text!r}."
                )
        server = _server(environ.get(STORE), data)
        if isinstance(server, str):
            faults.append(server)
        values["store"] = server
        return faults or cls(**values)


def _server(address: str | None, data: Path | None) -> Server | str | None:
    """Return the server that the ledger lies in, None where it is a file, or what is wrong with what was said of it."""
    if not address and data is not None:
        try:
            address = stored_address(data)
        except NotADirectoryError:
            return None  # there is no such folder, which is for the one to say who makes it
        except OSError as error:
            return f"{data / STORE_FILE}, which says where the ledger lies, can't be read ({error.strerror})."
    server = server_at(address) if address else None
    if isinstance(server, Server) and importlib.util.find_spec(DRIVER) is None:
        return f"The ledger lies in a server, and its driver is not installed: pip install '{EXTRA}'."
    return server
