"""Ledgers of older versions on the way to this one: a real core starts on them, or a spare is promoted onto them."""

import os
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from core.journal.schema import SCHEMA_VERSION
from tests.integration.lone_core import ready, started, verify
from tests.integration.wired_core import Guard, guarding

STRACE = shutil.which("strace")
LEDGERS = Path(__file__).parents[1] / "unit" / "core"
KEPT = {version: f"ledger-schema{version}-epoch1.db" for version in (2, 3, 4)}


@pytest.fixture
def guard(tmp_path: Path) -> Iterator[Guard]:
    with guarding(tmp_path) as made:
        yield made


def old_ledger(data: Path, version: int) -> None:
    data.mkdir(mode=0o700)
    (data / "ledger.lock").touch(0o600)
    with closing(sqlite3.connect(data / "ledger.db", isolation_level=None)) as store:
        store.executescript((LEDGERS / f"ledger_of_version_{version}.sql").read_text())


def version_of(file: Path) -> int:
    with closing(sqlite3.connect(f"{file.as_uri()}?mode=ro", uri=True)) as store:
        found: int = store.execute("SELECT schema_version FROM meta").fetchone()[0]
    return found


@pytest.mark.parametrize("version", [2, 3, 4])
def test_a_core_takes_an_older_ledger_along_and_keeps_it_as_it_was(tmp_path: Path, version: int) -> None:
    data = tmp_path / "data"
    old_ledger(data, version)
    with started(data) as core:
        events = ready(core).ask("GET", "/api/ledger/events").body["items"]
        assert core.open("new").status == 201
        core.process.terminate()
        assert core.ends_with() == 0
    assert verify(data).returncode == 0
    kept = data / "backups" / KEPT[version]
    assert (version_of(data / "ledger.db"), version_of(kept)) == (SCHEMA_VERSION, version)
    back = tmp_path / "back"
    back.mkdir()
    (back / "ledger.db").write_bytes(kept.read_bytes())
    if version >= 3:
        assert verify(back).returncode == 0, "it is proven as it stands"
    with started(back) as core:
        assert ready(core).ask("GET", "/api/ledger/events").body["items"] == events


def test_a_spare_says_that_it_would_take_the_ledger_along_and_does_so_when_it_is_promoted(
    guard: Guard,
) -> None:
    old_ledger(guard.data, 3)
    spare = guard.spare()
    told = spare.hears("X_SPARE")
    assert (told["X_SCHEMA"], told["X_MIGRATES"]) == ("3", "1")
    assert version_of(guard.data / "ledger.db") == 3
    assert spare.promote(1) == {"ok": True}
    assert spare.hears("READY")["X_EPOCH"] == "2"
    assert version_of(guard.data / "ledger.db") == SCHEMA_VERSION
    assert [file.name for file in (guard.data / "backups").iterdir()] == [KEPT[3]]
    assert spare.core.open("new").status == 201
    assert verify(guard.data).returncode == 0


def test_a_ledger_that_can_not_be_kept_is_left_as_it_is(tmp_path: Path) -> None:
    data = tmp_path / "data"
    old_ledger(data, 3)
    (data / "backups").write_text("in the way")
    with started(data) as core:
        assert core.ends_with() == 78
        assert "nothing was changed" in core.said()
    assert version_of(data / "ledger.db") == 3


def test_an_older_ledger_can_be_read_where_nothing_can_be_written(guard: Guard) -> None:
    old_ledger(guard.data, 3)
    life = guard.core(HARDCORE_SAFE="DISK_FULL")
    assert len(life.core.ask("GET", "/api/ledger/events").body["items"]) == 15
    assert life.core.ask("GET", "/api/ledger/verify").body["ok"] is True
    assert version_of(guard.data / "ledger.db") == 3


@pytest.mark.parametrize(("safe", "word"), [("DISK_FULL", "DISK_FULL"), ("DISK_READ_ONLY", "DISK_READ_ONLY")])
def test_a_ledger_too_old_to_be_read_as_it_stands_is_no_mistake_in_a_setting_while_its_disk_takes_no_write(
    guard: Guard, safe: str, word: str
) -> None:
    old_ledger(guard.data, 2)
    life = guard.start(HARDCORE_SAFE=safe)
    assert life.core.ends_with() == 73
    words = life.page().last_words
    assert words is not None
    assert words.code == word
    assert "schema 2" in life.core.said()
    assert version_of(guard.data / "ledger.db") == 2


def dying_at_flush(number: int) -> list[str]:
    """A command line that becomes the one behind it, which is killed at its so manieth flush of a whole file."""
    inject = f"--inject=fsync:signal=KILL:when={number}"
    return [STRACE or "strace", "-D", "-f", "-q", "-o", "/dev/null", inject]


@pytest.mark.skipif(STRACE is None, reason="no strace here")
def test_a_start_that_dies_over_the_copy_is_followed_by_one_that_goes_on_from_what_is_whole(
    tmp_path: Path,
) -> None:
    data = tmp_path / "data"
    old_ledger(data, 3)
    with started(data, before=dying_at_flush(1)) as core:
        assert core.ends_with() == -9
    (left,) = (data / "backups").iterdir()
    assert left.name == f"{KEPT[3]}.part"
    with started(data, before=dying_at_flush(2)) as core:
        assert core.ends_with() == -9
    (kept,) = (data / "backups").iterdir()
    assert kept.name == KEPT[3]
    os.utime(kept, (1, 1))
    assert version_of(data / "ledger.db") == 3
    with started(data) as core:
        ready(core)
    assert (kept.stat().st_mtime, version_of(data / "ledger.db")) == (1, SCHEMA_VERSION)
