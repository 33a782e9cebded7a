"""What the operator wants outlives a damaged file, and is never lost in silence."""

import os
from pathlib import Path

import pytest

from hardcore import standing
from hardcore.host import files, wish
from hardcore.host.folders import Folders
from hardcore.model.phases import Wanted
from hardcore.status import from_files


@pytest.fixture
def folders(tmp_path: Path) -> Folders:
    made = Folders(tmp_path / "data", tmp_path / "run")
    made.state.mkdir(parents=True)
    made.run.mkdir()
    return made


DAMAGED = (
    b"",
    b'{"wanted": "SA',
    b'{"wanted": [1]}',
    b'{"wanted": "UP"',
    b'{"wanted": {}, "before": {}}',
    b'"SAFE"',
    b"\xff",
    b"[" * 9000,
)


def test_where_nobody_has_said_anything_it_is_to_run(folders: Folders) -> None:
    assert wish.read(folders) == wish.Wish(Wanted.UP)


@pytest.mark.parametrize("data", DAMAGED)
def test_a_damaged_wish_is_remembered_by_its_copy(folders: Folders, data: bytes) -> None:
    for said in (Wanted.SAFE, Wanted.DOWN, Wanted.UP):
        standing.store_wanted(folders, said, "audit")
        (folders.state / "wanted.json").write_bytes(data)
        assert standing.wanted(folders) is said


@pytest.mark.parametrize("data", DAMAGED)
def test_a_damaged_wish_that_nobody_remembers_is_reads_only_and_says_so(
    folders: Folders, data: bytes
) -> None:
    (folders.state / "wanted.json").write_bytes(data)
    assert standing.wanted(folders) is Wanted.SAFE
    assert "safe-mode off" in standing.safe_reason(folders)
    assert from_files(folders)["wanted"] == "SAFE"
    standing.store_wanted(folders, Wanted.UP)
    assert standing.wanted(folders) is Wanted.UP


def test_a_pipe_in_the_place_of_a_small_file_holds_nobody_up(folders: Folders) -> None:
    os.mkfifo(folders.state / "wanted.json")
    assert files.read_json(folders.state / "wanted.json") == {}
    assert standing.wanted(folders) is Wanted.SAFE


def test_half_a_character_is_written_as_a_question_mark(folders: Folders) -> None:
    standing.store_wanted(folders, Wanted.SAFE, "because \ud800")
    assert standing.safe_reason(folders) == "because ?"


@pytest.mark.parametrize("number", [2**64, -1, True, 1.5, "7", None, 10**400])
def test_a_generation_that_no_guard_has_written_counts_as_none(folders: Folders, number: object) -> None:
    files.write_json(folders.generation, {"generation": number})
    assert standing.next_generation(folders) == 1
