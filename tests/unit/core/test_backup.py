"""What is kept of a ledger before it is brought to a newer schema: on real stores of older versions."""

import sqlite3
from pathlib import Path
from typing import Any

import pytest

from core import departure
from core.departure import ExitCode
from core.guarded.recorder import NoRecorder
from core.journal import backup, schema
from core.journal.backup import BACKUPS, KEPT, back_up, backup_name
from core.journal.store import LEDGER_FILE, StoreError, StoreFault, open_reading
from core.journal.verify import Verdict, verify
from core.opening import OpenBook, Telling, Terms, open_book
from core.settings import Settings
from tests.unit.core.books import moving, opening, order, pen, tamper
from tests.unit.core.test_entries import old_ledger
from tests.unit.core.test_verify import verdict, whole_book


class Ear:
    """A beacon that only listens."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def __getattr__(self, name: str) -> Any:
        return lambda *_, **__: self.said.append(name)


def opened_book(path: Path, expected: int | None = None, ear: Ear | None = None) -> Any:
    said: Any = ear or Ear()
    terms = Terms(expected, (), None, shared=True)
    found = open_book(path, terms, Settings(), Telling(NoRecorder(), said))
    if isinstance(found, OpenBook):
        found.journal.close()
        found.guard.release()
    return found


def version_of(file: Path) -> int:
    connection = sqlite3.connect(f"{file.as_uri()}?mode=ro", uri=True)
    try:
        return int(connection.execute("SELECT schema_version FROM meta").fetchone()[0])
    finally:
        connection.close()


def names(path: Path) -> set[str]:
    folder = path / BACKUPS
    return {file.name for file in folder.iterdir()} if folder.exists() else set()


@pytest.mark.parametrize("version", [2, 3])
def test_an_older_ledger_is_kept_before_it_is_brought_up_and_what_was_kept_can_be_gone_back_to(
    tmp_path: Path, version: int
) -> None:
    data, back = tmp_path / "data", tmp_path / "back"
    data.mkdir()
    back.mkdir()
    old_ledger(data, version)
    found = opened_book(data, 1)
    assert isinstance(found, OpenBook), found
    assert found.epoch == 2
    assert version_of(data / LEDGER_FILE) == schema.SCHEMA_VERSION
    assert verdict(data).ok
    assert names(data) == {backup_name(version, 1)}
    kept = data / BACKUPS / backup_name(version, 1)
    assert (version_of(kept), kept.stat().st_mode & 0o777) == (version, 0o600)
    kept.rename(back / LEDGER_FILE)
    again = opened_book(back, 1)
    assert isinstance(again, OpenBook)
    assert (again.proof.head_seq, again.proof.head_hash) == (found.proof.head_seq, found.proof.head_hash)
    assert verdict(back).ok


def test_a_ledger_of_version_3_is_proven_as_it_stands(tmp_path: Path) -> None:
    old_ledger(tmp_path, 3)
    readers = open_reading(tmp_path / LEDGER_FILE, 1, 1_000)
    found = verify(readers, 5_000, lambda: False)
    readers.dispose()
    assert isinstance(found, Verdict)
    assert found.ok, found.reason
    assert version_of(tmp_path / LEDGER_FILE) == 3


def test_a_ledger_of_this_version_is_not_copied(tmp_path: Path) -> None:
    whole_book(tmp_path)
    assert isinstance(opened_book(tmp_path), OpenBook)
    assert names(tmp_path) == set()


def test_what_stands_in_the_log_alone_is_kept_too(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"), opening("b"))
        for number in range(5):
            made.write(order(moving(1, "a", "b"), f"k{number}"))
        assert back_up(tmp_path / LEDGER_FILE, 4, 1, 1, lambda: None) is None
        kept = sqlite3.connect(tmp_path / BACKUPS / backup_name(4, 1))
        assert kept.execute("SELECT head_seq FROM meta").fetchone() == (7,)
        assert kept.execute("PRAGMA journal_mode").fetchone() == ("delete",)
        kept.close()
        assert names(tmp_path) == {backup_name(4, 1)}


@pytest.mark.parametrize(
    ("error", "code", "word"),
    [
        (StoreError(StoreFault.NO_ROOM, "ENOSPC"), ExitCode.DISK_FULL, "DISK_FULL"),
        (StoreError(StoreFault.READ_ONLY, "EROFS"), ExitCode.DISK_FULL, "DISK_READ_ONLY"),
        (StoreError(StoreFault.DAMAGED, "ill"), ExitCode.STORE_CORRUPT, "STORE_CORRUPT"),
        (StoreError(StoreFault.OTHER, "EACCES"), ExitCode.CONFIG_INVALID, "CONFIG_INVALID"),
    ],
)
def test_a_ledger_that_can_not_be_kept_is_not_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: StoreError, code: ExitCode, word: str
) -> None:
    old_ledger(tmp_path)
    monkeypatch.setattr(backup, "copy_whole", lambda *_: error)
    left = opened_book(tmp_path, 1)
    assert isinstance(left, departure.Departure)
    assert (left.code, left.word) == (code, word)
    assert "schema 2 to 4" in left.sentence
    assert "nothing was changed" in left.sentence
    assert error.text in left.sentence
    assert names(tmp_path) == set()
    connection = sqlite3.connect(tmp_path / LEDGER_FILE)
    assert connection.execute("SELECT schema_version, epoch FROM meta").fetchone() == (2, 1)
    connection.close()


def test_a_copy_that_would_not_fit_is_not_begun(tmp_path: Path) -> None:
    whole_book(tmp_path)
    error = back_up(tmp_path / LEDGER_FILE, 3, 1, 1 << 60, lambda: None)
    assert error is not None
    assert error.fault is StoreFault.NO_ROOM
    assert names(tmp_path) == set()


def test_a_folder_that_can_not_be_made_is_told(tmp_path: Path) -> None:
    whole_book(tmp_path)
    (tmp_path / BACKUPS).write_bytes(b"")
    error = back_up(tmp_path / LEDGER_FILE, 3, 1, 1, lambda: None)
    assert error is not None
    assert error.fault is StoreFault.OTHER


def test_the_newest_few_are_kept_and_what_a_death_left_is_replaced(tmp_path: Path) -> None:
    whole_book(tmp_path)
    (tmp_path / BACKUPS).mkdir()
    (tmp_path / BACKUPS / f"{backup_name(4, 9)}.part").write_bytes(b"half")
    for epoch in range(7, 7 + KEPT + 1):
        assert back_up(tmp_path / LEDGER_FILE, 4, epoch, 1, lambda: None) is None
    assert back_up(tmp_path / LEDGER_FILE, 4, 10, 1, lambda: None) is None
    assert names(tmp_path) == {backup_name(4, epoch) for epoch in (8, 9, 10)}


@pytest.mark.parametrize(("version", "says"), [(99, "newer version"), (1, "older than 2")])
def test_a_ledger_of_another_schema_is_refused_with_the_next_step(
    tmp_path: Path, version: int, says: str
) -> None:
    whole_book(tmp_path)
    tamper(tmp_path, f"UPDATE meta SET schema_version = {version}")
    left = opened_book(tmp_path)
    assert isinstance(left, departure.Departure)
    assert left.code is ExitCode.CONFIG_INVALID
    assert says in left.sentence
    assert "Nothing was changed" in left.sentence
