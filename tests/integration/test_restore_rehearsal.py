"""The rehearsal of a restore: a copy that would open is told from one that would not, and nothing is left of either."""

import json
import shutil
import sqlite3
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from core.journal.backup import BACKUPS, backup_name
from core.journal.store import LEDGER_FILE
from tests import stores
from tests.integration.lone_core import ROOT, clean_environment, ready, started
from tests.unit.core.test_entries import old_ledger

pytestmark = pytest.mark.in_a_file  # each spoils a copy of its own


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ledger of a few events at which nobody is at work."""
    data = tmp_path_factory.mktemp("restore") / "data"
    data.mkdir()
    with started(data) as core:
        ready(core)
        for name in ("a", "b"):
            assert core.open(name).status == 201
        assert core.move(5, "a", "b").status == 201
        core.process.terminate()
        assert core.ends_with() == 0
    return data


@pytest.fixture
def data(whole: Path, tmp_path: Path) -> Path:
    """A copy of that one, for a test that spoils it."""
    return Path(shutil.copytree(whole, tmp_path / "data"))


def rehearse(data: Path, *arguments: str) -> "subprocess.CompletedProcess[bytes]":
    argv = [sys.executable, "-m", "core", "rehearse-restore", "--data", str(data), *arguments]
    return subprocess.run(
        argv, cwd=ROOT, env=clean_environment(), capture_output=True, timeout=60, check=False
    )


def told(done: "subprocess.CompletedProcess[bytes]") -> dict[str, Any]:
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def keep_backup(data: Path, epoch: int = 1) -> Path:
    kept = data / BACKUPS / backup_name(2, epoch)
    kept.parent.mkdir(exist_ok=True)
    old_ledger(kept.parent)
    return (kept.parent / LEDGER_FILE).rename(kept)


def test_a_whole_ledger_and_its_newest_backup_of_an_older_schema_would_open(data: Path) -> None:
    keep_backup(data, 1)
    kept = keep_backup(data, 3)
    before = [path.read_bytes() for path in (data / "ledger.db", kept)]
    done = rehearse(data, "--json")
    report = told(done)
    with sqlite3.connect(f"file:{data}/ledger.db?mode=ro", uri=True) as connection:
        seq, head = connection.execute("SELECT head_seq, lower(hex(head_hash)) FROM meta").fetchone()
    assert (done.returncode, done.stderr) == (0, b"")
    assert (report["ok"], report["fault"], report["backup"]) == (True, None, kept.name)
    assert (report["events"], report["head"]) == (seq, head)
    assert [path.read_bytes() for path in (data / "ledger.db", kept)] == before
    assert list((data / "trials").iterdir()) == []


def test_a_ledger_that_is_not_whole_is_told_with_what_is_wrong(data: Path) -> None:
    stores.tamper(
        data,
        "UPDATE account SET posted = posted + 1 WHERE id = 'a'",
        "UPDATE account SET posted = posted - 1 WHERE id = 'b'",
    )
    done = rehearse(data, "--json")
    assert done.returncode == 65
    assert told(done)["ok"] is False
    assert "not whole" in told(done)["fault"]
    assert list((data / "trials").iterdir()) == []


def test_a_backup_that_is_damaged_is_named(data: Path) -> None:
    kept = keep_backup(data)
    raw = bytearray(kept.read_bytes())
    raw[4096:8192] = bytes(4096)
    kept.write_bytes(raw)
    done = rehearse(data, "--json")
    assert done.returncode == 65
    assert kept.name in told(done)["fault"]
    assert told(done)["events"] == 3


def test_where_there_is_no_ledger_one_sentence_says_so(tmp_path: Path) -> None:
    done = rehearse(tmp_path)
    assert (done.returncode, done.stdout) == (78, b"")
    assert b"no ledger" in done.stderr
