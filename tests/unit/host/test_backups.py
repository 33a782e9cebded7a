"""The folder of backups from outside: the guard finds what the ledger's side has made."""

import datetime as dt
from pathlib import Path

from core.keeping.shelf import SUFFIX, name_of, newest
from hardcore.host.backups import Kept, age_s, kept_in

NOON = dt.datetime(2026, 11, 23, 12, 0, tzinfo=dt.UTC)


def test_what_the_ledger_calls_its_newest_backup_is_what_the_guard_finds(tmp_path: Path) -> None:
    folder = tmp_path / "backups"
    folder.mkdir()
    names = [name_of(NOON - dt.timedelta(days=day), 100 - day) for day in range(3)]
    for name in (*names, *(name + SUFFIX for name in names[1:]), "photo.jpg", "ledger-schema4-epoch2.db"):
        (folder / name).touch()
    kept = kept_in(tmp_path)
    assert kept.name == newest(path.name for path in folder.iterdir()) == names[1]
    assert (kept.made_at, kept.count) == ("2026-11-22T12:00:00Z", 2)
    assert age_s(kept, NOON.timestamp()) == 86_400


def test_a_folder_that_is_not_there_has_none(tmp_path: Path) -> None:
    assert kept_in(tmp_path) == Kept()
    assert age_s(Kept(), 0.0) is None
