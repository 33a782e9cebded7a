"""What is kept of a ledger before it is brought to a newer schema: on real stores of older versions."""

import os
import sqlite3
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy.exc import OperationalError

from core import departure
from core.departure import ExitCode
from core.guarded.recorder import NoRecorder
from core.journal import backup, schema
from core.journal.as_it_stands import open_as_it_stands
from core.journal.backup import BACKUPS, KEPT, back_up, backup_name
from core.journal.room import ROOM_BYTES_MIN
from core.journal.store import (
    LEDGER_FILE,
    StoreError,
    StoreFault,
    close_writing,
    open_reading,
    size_bytes,
)
from core.journal.verify import Verdict, verify
from core.opening import OpenBook, Telling, Terms, open_book
from core.settings import Settings
from tests.unit.core.books import moving, opened, opening, order, pen, tamper
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


@pytest.mark.parametrize("version", [3, 4])
def test_an_older_ledger_is_proven_as_it_stands(tmp_path: Path, version: int) -> None:
    old_ledger(tmp_path, version)
    readers = open_as_it_stands(tmp_path / LEDGER_FILE, 1, 1_000)
    found = verify(readers, 5_000, lambda: False)
    readers.dispose()
    assert isinstance(found, Verdict)
    assert found.ok, found.reason
    assert version_of(tmp_path / LEDGER_FILE) == version


def test_a_ledger_of_this_version_is_not_copied(tmp_path: Path) -> None:
    whole_book(tmp_path)
    assert isinstance(opened_book(tmp_path), OpenBook)
    assert names(tmp_path) == set()


def test_what_stands_in_the_log_alone_is_kept_too(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"), opening("b"))
        for number in range(5):
            made.write(order(moving(1, "a", "b"), f"k{number}"))
        assert back_up(tmp_path / LEDGER_FILE, 4, 1, 1, 0, lambda: None) is None
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
    assert f"schema 2 to {schema.SCHEMA_VERSION}" in left.sentence
    assert "nothing was changed" in left.sentence
    assert error.text in left.sentence
    assert names(tmp_path) == set()
    connection = sqlite3.connect(tmp_path / LEDGER_FILE)
    assert connection.execute("SELECT schema_version, epoch FROM meta").fetchone() == (2, 1)
    connection.close()


def test_a_copy_that_would_not_fit_is_not_begun(tmp_path: Path) -> None:
    whole_book(tmp_path)
    error = back_up(tmp_path / LEDGER_FILE, 3, 1, 1 << 60, 0, lambda: None)
    assert error is not None
    assert error.fault is StoreFault.NO_ROOM
    assert names(tmp_path) == set()


def test_a_folder_that_can_not_be_made_is_told(tmp_path: Path) -> None:
    whole_book(tmp_path)
    (tmp_path / BACKUPS).write_bytes(b"")
    error = back_up(tmp_path / LEDGER_FILE, 3, 1, 1, 0, lambda: None)
    assert error is not None
    assert error.fault is StoreFault.OTHER


def keep(path: Path, epoch: int, version: int = 4, tick: Any = lambda: None) -> StoreError | None:
    return back_up(path / LEDGER_FILE, version, epoch, 1, 0, tick)


def room_for(monkeypatch: pytest.MonkeyPatch, free_bytes: int) -> None:
    monkeypatch.setattr(backup, "free_bytes", lambda *_, **__: free_bytes)


def test_the_newest_few_are_kept_and_what_a_death_left_is_removed(tmp_path: Path) -> None:
    whole_book(tmp_path)
    (tmp_path / BACKUPS).mkdir()
    for name in (
        f"{backup_name(4, 9)}.part",
        f"{backup_name(3, 1)}.part",
        f"{backup_name(3, 1)}.part-journal",
    ):
        (tmp_path / BACKUPS / name).write_bytes(b"half")
    for epoch in range(7, 7 + KEPT + 1):
        assert keep(tmp_path, epoch) is None
    assert names(tmp_path) == {backup_name(4, epoch) for epoch in (8, 9, 10)}


def test_the_newest_few_go_by_their_names_and_the_one_just_made_is_always_kept(tmp_path: Path) -> None:
    """A clock that stood later before, or a ledger of another history with higher epochs."""
    whole_book(tmp_path)
    (tmp_path / BACKUPS).mkdir()
    for version, epoch in ((2, 30), (3, 4), (3, 20), (3, 100)):
        old = tmp_path / BACKUPS / backup_name(version, epoch)
        old.write_bytes(b"x")
        later_s = old.stat().st_mtime + 3600 - epoch
        os.utime(old, (later_s, later_s))
    (tmp_path / BACKUPS / "ledger-schema3-epoch1.db.mine").write_bytes(b"of a person")
    assert keep(tmp_path, 5, version=3) is None
    assert names(tmp_path) == {
        *(backup_name(3, epoch) for epoch in (5, 20, 100)),
        "ledger-schema3-epoch1.db.mine",
    }


def old(kept: Path) -> Path:
    os.utime(kept, (1, 1))
    return kept


def is_old(kept: Path) -> bool:
    return kept.stat().st_mtime == 1


def test_a_start_that_died_after_its_copy_makes_no_second_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would not fit beside the first, and the ledger would never come up again."""
    whole_book(tmp_path)
    assert keep(tmp_path, 3) is None
    kept = old(tmp_path / BACKUPS / backup_name(4, 3))
    room_for(monkeypatch, ROOM_BYTES_MIN)
    assert keep(tmp_path, 3) is None
    assert is_old(kept)


@pytest.mark.parametrize("falsified", ["cut", "strange", "behind", "lacks a refusal"])
def test_what_lies_under_the_name_and_is_not_this_ledger_is_replaced(tmp_path: Path, falsified: str) -> None:
    whole_book(tmp_path)
    assert keep(tmp_path, 3) is None
    kept = tmp_path / BACKUPS / backup_name(4, 3)
    match falsified:
        case "cut":
            os.truncate(kept, kept.stat().st_size // 2)
        case "strange":
            kept.write_bytes(b"no ledger")
        case "behind":
            with pen(tmp_path) as made:
                made.write(order(opening("one-more"), "k-late"))
        case _:
            with pen(tmp_path) as made:
                made.write(order(moving(1, "not", "there"), "refused"))
    old(kept)
    assert keep(tmp_path, 3) is None
    assert not is_old(kept)
    readers = open_reading(kept, 1, 1_000)
    again = verify(readers, 5_000, lambda: False)
    readers.dispose()
    assert isinstance(again, Verdict)
    assert again.ok, again.reason


def test_room_is_asked_for_after_what_a_death_left_was_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole_book(tmp_path)
    (tmp_path / BACKUPS).mkdir()
    part = tmp_path / BACKUPS / f"{backup_name(4, 3)}.part"
    part.write_bytes(b"x" * 4096)
    monkeypatch.setattr(
        backup, "free_bytes", lambda *_, **__: ROOM_BYTES_MIN if part.exists() else 2 * ROOM_BYTES_MIN
    )
    assert keep(tmp_path, 3) is None


def test_room_is_asked_for_the_copy_and_for_the_step_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole_book(tmp_path)
    ledger, copy_bytes, step_bytes = tmp_path / LEDGER_FILE, 1 << 20, 1 << 16
    room_for(monkeypatch, ROOM_BYTES_MIN + copy_bytes + step_bytes - 1)
    error = back_up(ledger, 4, 1, copy_bytes, step_bytes, lambda: None)
    assert error is not None
    assert error.fault is StoreFault.NO_ROOM
    assert names(tmp_path) == set()
    room_for(monkeypatch, ROOM_BYTES_MIN + copy_bytes + step_bytes)
    assert back_up(ledger, 4, 1, copy_bytes, step_bytes, lambda: None) is None
    room_for(monkeypatch, ROOM_BYTES_MIN + step_bytes - 1)
    assert back_up(ledger, 4, 1, copy_bytes, step_bytes, lambda: None) is not None
    assert names(tmp_path) == {backup_name(4, 1)}


@pytest.mark.parametrize("version", [2, 3])
def test_a_step_takes_no_more_room_than_it_was_said_to(tmp_path: Path, version: int) -> None:
    old_ledger(tmp_path, version)
    lines = 20_000
    tamper(
        tmp_path,
        f"WITH RECURSIVE n(i) AS (SELECT 1000 UNION ALL SELECT i + 1 FROM n WHERE i < {1000 + lines})"
        " INSERT INTO posting (seq, line, account_id, amount) SELECT i, 0, 'assets:bank', i FROM n",
        "INSERT INTO booking (id, seq, date, description)"
        " SELECT 'id-' || seq, seq, '2026-11-21', '' FROM posting WHERE seq >= 1000",
        "PRAGMA journal_mode = WAL",
    )
    connection = opened(tmp_path)
    log = tmp_path / f"{LEDGER_FILE}-wal"
    before = size_bytes(connection)
    connection.exec_driver_sql("PRAGMA wal_autocheckpoint = 0").close()
    connection.exec_driver_sql("BEGIN IMMEDIATE").close()
    said = schema.bring_up_bytes(connection, version)
    schema.bring_up(connection, version)
    connection.exec_driver_sql("COMMIT").close()
    took = log.stat().st_size + size_bytes(connection) - before
    close_writing(connection)
    assert took <= said + ROOM_BYTES_MIN


def test_a_step_that_fails_after_the_copy_goes_on_from_it_at_the_next_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old_ledger(tmp_path)

    def fill(*_: object) -> None:
        full = sqlite3.OperationalError("database or disk is full")
        full.sqlite_errorcode = sqlite3.SQLITE_FULL
        raise OperationalError("", {}, full)

    with monkeypatch.context() as filled:
        filled.setattr(schema, "bring_up", fill)
        left = opened_book(tmp_path, 1)
    assert isinstance(left, departure.Departure)
    assert left.code is ExitCode.DISK_FULL
    kept = old(tmp_path / BACKUPS / backup_name(2, 1))
    room_for(monkeypatch, ROOM_BYTES_MIN + (tmp_path / LEDGER_FILE).stat().st_size - 1)
    found = opened_book(tmp_path, 1)
    assert isinstance(found, OpenBook), found
    assert is_old(kept)
    assert version_of(kept) == 2


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
