"""Where a book lies: in a file, or in a database of a server. Which of the two it is, is said once, at a start.

The address of a server may hold a password. It is never shown: neither by whoever prints this, nor in a sentence.
"""

from pathlib import Path
from typing import Final

import msgspec
from sqlalchemy import URL, make_url
from sqlalchemy.exc import ArgumentError

_DRIVER: Final = "postgresql+psycopg"
_SCHEMES: Final = frozenset({_DRIVER, "postgresql", "postgres"})


class Server(msgspec.Struct, frozen=True):
    """A database of a PostgreSQL server."""

    url: URL

    def __repr__(self) -> str:
        """Say which one, without its password."""
        return self.shown

    @property
    def shown(self) -> str:
        """What a person may read: where, which database and whose, and nothing that stands behind it."""
        url = self.url
        host = url.host or url.query.get("host") or "this machine"
        return f"database {url.database or url.username or ''} on {host}{f':{url.port}' if url.port else ''}"

    @property
    def has_password(self) -> bool:
        """Whether the address itself holds a password."""
        return self.url.password is not None or "password" in self.url.query


Whereabouts = Path | Server


def server_at(text: str) -> Server | str:
    """Return the server that an address leads to, or one sentence why it leads nowhere, which does not repeat it."""
    try:
        url = make_url(text)
    except (ArgumentError, ValueError):  # the latter: a port that is no number
        return "The address of the store can't be read: write postgresql://USER@HOST:PORT/DATABASE."
    if url.drivername not in _SCHEMES:
        return (
            "The address of the store must begin with postgresql://, as in postgresql://USER@HOST:PORT/DATABASE;"
            " without an address the ledger is a file in the data folder."
        )
    if not url.database:
        return "The address of the store names no database: write postgresql://USER@HOST:PORT/DATABASE."
    return Server(url.set(drivername=_DRIVER))
