"""The file in a data folder that says that its ledger lies in a server, and where.

It is written once, when a household is started with an address, and read by every core and every command that is given
the folder, so none of them needs to be told: an address may hold a password, and neither a command line nor an
environment is a place for that. It is its owner's alone.
"""

from pathlib import Path
from typing import Final

STORE_FILE: Final = "store"
BYTES_MAX: Final = 4_096


def stored_address(data: Path) -> str | None:
    """Return the address that a data folder keeps; None: its ledger is a file. OSError where that can't be known."""
    try:
        with (data / STORE_FILE).open("rb") as file:
            return file.read(BYTES_MAX).decode("utf-8", "replace").strip()
    except FileNotFoundError:
        return None
