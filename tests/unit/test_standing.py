"""Whose the run folder is."""

from pathlib import Path

import pytest

from hardcore import standing
from hardcore.host import files
from hardcore.host.folders import Folders


@pytest.fixture
def folders(tmp_path: Path) -> Folders:
    made = Folders(tmp_path / "data", tmp_path / "run")
    made.state.mkdir(parents=True)
    made.run.mkdir()
    made.recorder("0123").touch()
    return made


def has_page(folders: Folders) -> bool:
    return folders.recorder("0123").exists()


def test_the_pages_of_another_data_folder_are_removed_at_the_first_start(folders: Folders) -> None:
    standing.own_run_folder(folders)
    assert not has_page(folders)


def test_the_pages_of_the_same_data_folder_stay(folders: Folders) -> None:
    standing.own_run_folder(folders)
    folders.recorder("0123").touch()
    standing.own_run_folder(folders)
    assert has_page(folders)


def test_the_pages_of_data_from_before_there_were_identities_stay(folders: Folders) -> None:
    standing.keep(folders, standing.next_generation(folders))
    standing.own_run_folder(folders)
    standing.own_run_folder(folders)
    assert has_page(folders)


def test_a_new_data_folder_beside_pages_whose_owner_is_known_has_none_of_them(folders: Folders) -> None:
    standing.keep(folders, standing.next_generation(folders))
    files.write_json(folders.run / "instance.json", {"instance": "another"})
    standing.own_run_folder(folders)
    assert not has_page(folders)


def test_an_identity_that_cannot_be_read_leaves_the_pages_where_they_are(folders: Folders) -> None:
    (folders.state / "instance.json").write_text("{")
    standing.own_run_folder(folders)
    assert has_page(folders)


def test_without_a_spare_by_the_command_line_is_no_part_of_the_policy_that_is_kept(
    folders: Folders, monkeypatch: pytest.MonkeyPatch
) -> None:
    folders.policy.write_text('{"spare": true}')
    monkeypatch.setenv(standing.NO_SPARE_SWITCH, "1")
    assert standing.policy_in_force(folders).policy.spare is False
    standing.keep(folders, 1)
    monkeypatch.delenv(standing.NO_SPARE_SWITCH)
    assert standing.policy_in_force(folders).policy.spare is True
    assert folders.good_policy.read_text() == folders.policy.read_text()


def test_a_guard_that_follows_another_waits_for_no_disk(
    folders: Folders, monkeypatch: pytest.MonkeyPatch
) -> None:
    folders.policy.write_text("{}")
    standing.own_run_folder(folders)

    def hangs(_fd: int) -> None:
        pytest.fail("whoever waits here is not there when a core dies")

    monkeypatch.setattr("os.fsync", hangs)
    standing.own_run_folder(folders)
    assert [standing.next_generation(folders), standing.next_generation(folders)] == [1, 2]
    assert not standing.policy_in_force(folders).fault


def test_a_policy_that_was_mended_becomes_the_last_good_one(folders: Folders) -> None:
    for text in ('{"spare": true}', '{"spare": false}', "{"):
        folders.policy.write_text(text)
        standing.keep(folders, 1)
    assert folders.good_policy.read_text() == '{"spare": false}'


def test_a_file_with_two_faults_is_said_to_have_more_than_the_first(folders: Folders) -> None:
    folders.policy.write_text('{"version": 1, "max_restart_count": -1, "no_such_name": 7}', "utf-8")
    fault = standing.policy_in_force(folders).fault
    assert "max_restart_count" in fault or "no_such_name" in fault
    assert "and 1 more" in fault
