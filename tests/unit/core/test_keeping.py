"""Kept copies: which may go, what counts as one, and the way back to one."""

import datetime as dt
import sqlite3
from pathlib import Path

import msgspec
import pytest

from core.journal.store import LEDGER_FILE
from core.keeping import making, shelf
from core.keeping.making import NotMade, make
from core.keeping.restoring import NotRestored, restore
from core.keeping.shelf import SUFFIX, Note, made_at, name_of, newest, superfluous
from core.rulings import Rulings
from core.settings import Settings
from tests.unit.core.books import entering, opening, pen

NOON = dt.datetime(2026, 11, 23, 12, 0, tzinfo=dt.UTC)
NAMES = [name_of(NOON + dt.timedelta(days=day), 100 + day) for day in range(5)]


def silent(_doing: str, _percent: int | None) -> None:
    """Hear how far it is."""


def ledger(data: Path, entries: int = 3) -> Path:
    data.mkdir(parents=True, exist_ok=True)
    with pen(data) as made:
        made.carry_out(opening("bank"), *(entering(f"-{100 + n}") for n in range(entries)))
    return data / LEDGER_FILE


def kept(data: Path, keep: int = 14, now: dt.datetime = NOON) -> tuple[Path, Note]:
    made = make(data / LEDGER_FILE, data / "backups", keep, Rulings(), data / "none", now, silent)
    assert not isinstance(made, NotMade), made
    return made


def test_a_name_says_when_the_copy_was_made_and_how_far_it_goes() -> None:
    assert NAMES[0] == "ledger-20261123T120000Z-seq100.db"
    assert made_at(NAMES[0]) == NOON
    assert [
        made_at(name) for name in ("ledger.db", "ledger-schema4-epoch2.db", "ledger-20269923T120000Z-seq1.db")
    ] == [None] * 3


def test_the_oldest_go_and_never_the_newest_nor_what_is_not_ours_nor_what_was_never_proven() -> None:
    unproven = name_of(NOON - dt.timedelta(days=9), 1)
    there = [*NAMES, *(name + SUFFIX for name in NAMES), unproven, "photo.jpg", "ledger-schema4-epoch2.db"]
    assert superfluous(there, 2) == NAMES[:3]
    assert superfluous(there, 9) == []
    assert newest(there) == NAMES[-1]
    assert newest([unproven, "photo.jpg"]) is None


def test_a_copy_is_proven_and_says_what_it_holds(tmp_path: Path) -> None:
    ledger(tmp_path)
    path, note = kept(tmp_path)
    assert path.name == name_of(NOON, note.events)
    assert note.events == 5  # two accounts (one for what has no category) and three entries
    assert note.trial_balance == {"KRW": "0"}
    assert path.stat().st_mode & 0o777 == 0o600
    written = msgspec.json.decode((path.parent / (path.name + SUFFIX)).read_bytes(), type=Note)
    assert written == note
    assert {one.name for one in path.parent.iterdir()} == {path.name, path.name + SUFFIX}


def test_as_many_copies_stay_as_are_wanted(tmp_path: Path) -> None:
    ledger(tmp_path)
    made = [kept(tmp_path, 2, NOON + dt.timedelta(days=day))[0].name for day in range(4)]
    assert {one.name for one in (tmp_path / "backups").glob("*.db")} == set(made[2:])
    assert len(list((tmp_path / "backups").iterdir())) == 4


def test_what_a_death_has_left_half_way_is_no_copy_and_is_removed_by_the_next(tmp_path: Path) -> None:
    ledger(tmp_path)
    folder = tmp_path / "backups"
    folder.mkdir()
    left = folder / f"77{making.PART}"
    left.write_bytes(b"half")
    assert shelf.newest(one.name for one in folder.iterdir()) is None
    kept(tmp_path)
    assert not left.exists()


def test_a_ledger_that_is_not_whole_is_not_kept_and_the_older_copies_stay(tmp_path: Path) -> None:
    path = ledger(tmp_path)
    good, _ = kept(tmp_path, keep=1)
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE posting SET amount = amount + 1 WHERE seq = 3 AND line = 0")
    connection.close()
    made = make(
        path, tmp_path / "backups", 1, Rulings(), tmp_path / "none", NOON + dt.timedelta(days=1), silent
    )
    assert isinstance(made, NotMade)
    assert "not whole" in made.sentence
    assert {one.name for one in good.parent.iterdir()} == {good.name, good.name + SUFFIX}


def test_a_folder_that_takes_no_copy_is_said_with_the_next_step(tmp_path: Path) -> None:
    path = ledger(tmp_path)
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    made = make(path, tmp_path / "file", 1, Rulings(), tmp_path / "none", NOON, silent)
    assert isinstance(made, NotMade)
    assert "--to" in made.sentence


def test_a_copy_goes_back_into_an_empty_folder_and_is_the_same_book(tmp_path: Path) -> None:
    ledger(tmp_path / "old")
    path, note = kept(tmp_path / "old")
    back = restore(path, tmp_path / "new", LEDGER_FILE, Settings(), silent)
    assert isinstance(back, Note), back
    assert (back.events, back.head, back.epoch) == (note.events, note.head, note.epoch)
    assert [one.name for one in (tmp_path / "new").iterdir()] == [LEDGER_FILE]
    with pen(tmp_path / "new") as made:  # and it can be written on
        assert made.carry_out(entering("-7"))


def test_nothing_is_ever_written_over(tmp_path: Path) -> None:
    path = ledger(tmp_path)
    copy, _ = kept(tmp_path)
    before = path.read_bytes()
    back = restore(copy, tmp_path, LEDGER_FILE, Settings(), silent)
    assert isinstance(back, NotRestored)
    assert path.read_bytes() == before


@pytest.mark.parametrize("harm", ["cut", "changed", "text"])
def test_a_damaged_copy_is_refused_and_leaves_no_ledger(tmp_path: Path, harm: str) -> None:
    ledger(tmp_path / "old", entries=40)
    copy, _ = kept(tmp_path / "old")
    if harm == "cut":
        copy.write_bytes(copy.read_bytes()[:30_000])
    elif harm == "changed":
        with sqlite3.connect(copy) as connection:
            connection.execute("DROP TRIGGER event_is_never_changed")
            connection.execute("UPDATE event SET booked_ns = booked_ns + 1 WHERE seq = 4")
        connection.close()
    else:
        copy.write_text("dear ledger", encoding="utf-8")
    back = restore(copy, tmp_path / "new", LEDGER_FILE, Settings(), silent)
    assert isinstance(back, NotRestored)
    assert not (tmp_path / "new" / LEDGER_FILE).exists()
    assert not list((tmp_path / "new").iterdir())
