"""Who holds the store's write lock, told by the kernel's table and never by opening the store."""

import os
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from msgspec.structs import replace

from hardcore.host import locks
from tests.waiting import until

TABLE = """\
1: POSIX  ADVISORY  WRITE 4321 fe:01:77 120 120
1: -> POSIX  ADVISORY  WRITE 4400 fe:01:77 120 120
2: OFDLCK ADVISORY  READ  -1 00:2a:9 0 EOF
3: FLOCK  ADVISORY  WRITE 12 08:10:5 0 EOF
4: LEASE  ACTIVE    READ  13 08:10:5 0 EOF
5: POSIX  ADVISORY  WRITE
half a li
"""

HOLDER = """
import sqlite3, sys
book = sqlite3.connect(sys.argv[1], isolation_level=None)
book.execute("PRAGMA journal_mode = " + sys.argv[2])
book.execute("CREATE TABLE IF NOT EXISTS t (a)")
book.execute("BEGIN IMMEDIATE")
print("held", flush=True)
sys.stdin.read()
"""


def test_the_table_is_read_line_by_line_and_what_is_strange_is_left_out() -> None:
    held, waiting, open_file, whole = locks.parse(TABLE)
    assert held == locks.FileLock("POSIX", (0xFE, 1), 77, 4321, writes=True, waits=False, start=120, end=120)
    assert waiting.waits
    assert waiting.pid == 4400
    assert (open_file.pid, open_file.end, open_file.writes) == (0, None, False)
    assert whole.covers(1 << 40)
    assert not held.covers(121)


@contextmanager
def holding(store: Path, journal: str) -> Iterator[int]:
    argv = [sys.executable, "-c", HOLDER, str(store), journal]
    with subprocess.Popen(argv, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"held\n"
        yield process.pid
        process.kill()


def table() -> tuple[locks.FileLock, ...]:
    read = locks.read_table()
    assert not isinstance(read, str), read
    return read


@pytest.mark.parametrize("journal", ["WAL", "DELETE"])
def test_the_process_that_holds_the_write_lock_is_named_and_gone_from_the_list_when_it_is_gone(
    tmp_path: Path, journal: str
) -> None:
    store = tmp_path / "ledger.db"
    with holding(store, journal) as pid:
        (found,) = locks.writers_in(tmp_path, 1, table())
        assert (found.pid, found.ours) == (pid, False)
        assert found.name.startswith("python")
        (ours,) = locks.writers_in(tmp_path, pid, table())
        assert ours.ours
    until(lambda: not locks.writers_in(tmp_path, 1, table()), "the lock to be free")


def test_a_reader_of_the_store_holds_no_write_lock(tmp_path: Path) -> None:
    store = tmp_path / "ledger.db"
    with closing(sqlite3.connect(store, isolation_level=None)) as book:
        book.execute("PRAGMA journal_mode = WAL")
        book.execute("CREATE TABLE t (a)")
        book.execute("BEGIN")
        book.execute("SELECT * FROM t").fetchall()
        assert locks.writers_in(tmp_path, 1, table()) == ()


def test_where_the_table_knows_the_device_by_another_number_an_owner_that_has_the_file_open_counts(
    tmp_path: Path,
) -> None:
    store = tmp_path / "ledger.db"
    with holding(store, "WAL") as pid:
        there = [lock for lock in table() if lock.pid == pid]
        moved = [replace(lock, device=(9, 9)) for lock in there]
        assert [one.pid for one in locks.writers_in(tmp_path, 1, moved)] == [pid]
        strangers = [replace(lock, pid=os.getpid()) for lock in moved]
        assert locks.writers_in(tmp_path, 1, strangers) == ()


def test_a_store_that_is_not_there_has_no_writer(tmp_path: Path) -> None:
    assert locks.writers_in(tmp_path / "nowhere", 1, table()) == ()
