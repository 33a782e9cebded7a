"""The room that is kept for the fence."""

import os
from pathlib import Path

import pytest

from core.journal import ballast
from core.journal.ballast import BALLAST_BYTES, BALLAST_FILE, ROOM_BYTES, drop, lay_down


def test_the_ballast_is_allocated_and_not_only_said_to_be_long(tmp_path: Path) -> None:
    assert lay_down(tmp_path)
    seen = (tmp_path / BALLAST_FILE).stat()
    assert (seen.st_size, seen.st_mode & 0o777) == (BALLAST_BYTES, 0o600)
    assert seen.st_blocks * 512 >= BALLAST_BYTES
    assert lay_down(tmp_path)


def test_it_is_dropped_once(tmp_path: Path) -> None:
    assert not drop(tmp_path)
    assert lay_down(tmp_path)
    assert drop(tmp_path)
    assert not (tmp_path / BALLAST_FILE).exists()
    assert not drop(tmp_path)


def test_what_a_death_left_half_allocated_is_completed(tmp_path: Path) -> None:
    (tmp_path / BALLAST_FILE).write_bytes(b"x" * 4096)
    assert lay_down(tmp_path)
    assert (tmp_path / BALLAST_FILE).stat().st_size == BALLAST_BYTES


def test_a_copy_of_it_that_takes_no_room_is_allocated(tmp_path: Path) -> None:
    """Copied with holes, as a backup may be: it is all zeros."""
    path = tmp_path / BALLAST_FILE
    path.touch()
    os.truncate(path, BALLAST_BYTES)
    assert path.stat().st_blocks == 0
    assert lay_down(tmp_path)
    assert path.stat().st_blocks * 512 >= BALLAST_BYTES
    assert drop(tmp_path)


@pytest.mark.parametrize(("free", "laid"), [(ROOM_BYTES - 1, False), (ROOM_BYTES, True), (None, True)])
def test_it_is_laid_down_only_where_it_makes_no_full_disk_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free: int | None, *, laid: bool
) -> None:
    monkeypatch.setattr(ballast, "free_bytes", lambda *_, **__: free)
    assert lay_down(tmp_path) == laid
    assert (tmp_path / BALLAST_FILE).exists() == laid


def test_a_folder_that_is_gone_costs_nothing(tmp_path: Path) -> None:
    assert not lay_down(tmp_path / "gone")
    assert not drop(tmp_path / "gone")
    assert list(tmp_path.iterdir()) == []
