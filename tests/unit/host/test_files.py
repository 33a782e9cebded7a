"""Small files survive whatever happens in the middle; logs and folders keep their bounds."""

import errno
import json
import os
import shutil
import stat
from pathlib import Path

import pytest

from hardcore import standing
from hardcore.host import clock, deaths, files, folders, ids, logs
from hardcore.host.folders import Folders, Unusable

NS_PER_S = 1_000_000_000


@pytest.fixture
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A runtime folder of another environment; its name is short, so that sockets fit under it."""
    return tmp_path_factory.mktemp("o")


@pytest.fixture
def house(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> Folders:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("r")))
    made = folders.prepare(tmp_path / "data")
    assert isinstance(made, Folders)
    return made


# ---- files ----


def test_a_file_is_put_there_whole_for_its_owner_only(tmp_path: Path) -> None:
    path = tmp_path / "file"
    files.write_whole(path, b"one")
    files.write_whole(path, b"two")
    assert path.read_bytes() == b"two"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_write_that_fails_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.mkdir()
    (path / "inside").touch()
    with pytest.raises(OSError, match="directory") as caught:
        files.write_whole(path, b"x")
    assert caught.value.errno in {errno.EISDIR, errno.ENOTEMPTY}
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("content", [b"", b"{", b"[1]", b'"x"', b"\xff", b"[" * 100_000, b"null"])
def test_what_can_not_be_read_is_nothing(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "file").write_bytes(content)
    assert files.read_json(tmp_path / "file") == {}
    assert files.read_json(tmp_path / "absent") == {}


def test_a_lock_has_one_owner_until_it_is_closed(tmp_path: Path) -> None:
    first = files.take_lock(tmp_path / "lock")
    assert first is not None
    assert files.take_lock(tmp_path / "lock") is None
    os.close(first)
    second = files.take_lock(tmp_path / "lock")
    assert second is not None
    os.close(second)


# ---- folders ----


def test_folders_are_for_their_owner_only_and_run_is_a_link(house: Folders) -> None:
    assert (house.data / "run").readlink() == house.run
    for folder in (house.data, house.state, house.incidents, house.logs, house.run, house.exits):
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_a_moved_data_folder_gets_a_run_folder_and_a_link_of_its_own(house: Folders, tmp_path: Path) -> None:
    moved = tmp_path / "moved"
    house.data.rename(moved)
    again = folders.prepare(moved)
    assert isinstance(again, Folders)
    assert again.run != house.run
    assert (moved / "run").readlink() == again.run


def test_two_names_of_one_folder_are_one_instance(house: Folders, tmp_path: Path) -> None:
    (tmp_path / "alias").symlink_to(house.data)
    assert folders.locate(tmp_path / "alias") == house


def test_a_run_folder_that_others_can_open_is_refused(house: Folders) -> None:
    house.run.chmod(0o755)
    refused = folders.prepare(house.data)
    assert isinstance(refused, Unusable)
    assert str(house.run) in refused.reason


def test_a_file_where_the_link_belongs_is_refused_and_kept(tmp_path: Path, house: Folders) -> None:
    (house.data / "run").unlink()
    (house.data / "run").write_text("mine")
    refused = folders.prepare(house.data)
    assert isinstance(refused, Unusable)
    assert (house.data / "run").read_text() == "mine"
    assert str(tmp_path) in refused.reason


def test_the_link_leads_to_the_run_folder_from_every_environment(
    house: Folders, other: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for environment in (str(other), ""):
        monkeypatch.setenv("XDG_RUNTIME_DIR", environment)
        assert folders.locate(house.data) == house
        assert folders.prepare(house.data) == house
    assert not list(other.iterdir())


def test_a_link_to_a_folder_that_is_gone_is_made_anew_where_the_environment_says(
    house: Folders, other: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.rmtree(house.run)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(other))
    again = folders.prepare(house.data)
    assert isinstance(again, Folders)
    assert again.run.parent == other
    assert (house.data / "run").readlink() == again.run


def test_a_link_to_a_folder_that_others_can_open_is_not_followed(
    house: Folders, other: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    house.run.chmod(0o755)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(other))
    assert folders.locate(house.data).run.parent == other


def test_a_copy_of_a_data_folder_does_not_follow_the_link_of_its_original(
    house: Folders, tmp_path: Path
) -> None:
    shutil.copytree(house.data, tmp_path / "copy", symlinks=True)
    again = folders.prepare(tmp_path / "copy")
    assert isinstance(again, Folders)
    assert again.run != house.run


def test_a_generation_never_falls_back(house: Folders) -> None:
    taken = [standing.next_generation(house)]
    standing.keep(house, taken[-1])
    shutil.rmtree(house.run)
    house.run.mkdir(mode=0o700)
    taken.append(standing.next_generation(house))
    standing.keep(house, taken[-1])
    (house.state / "generation.json").unlink()
    (house.state / "generation.json").mkdir()  # as on a disk that takes nothing
    taken.append(standing.next_generation(house))
    assert taken == [1, 2, 3]


def test_sockets_fit_however_long_the_runtime_folder_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deep = tmp_path / ("x" * 90)
    deep.mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(deep))
    where = folders.locate(tmp_path / "data")
    assert len(os.fsencode(where.core_socket("0" * 16))) <= folders.SOCKET_PATH_BYTES_MAX


def test_a_folder_that_can_not_be_made_is_named_with_the_next_step() -> None:
    for place in ("/proc/nowhere", "/dev/null/data", "/tmp/" + "x" * 300):
        refused = folders.prepare(Path(place))
        assert isinstance(refused, Unusable)
        assert "--data" in refused.reason


# ---- the budget ----


def test_deaths_of_this_boot_keep_their_times(house: Folders) -> None:
    now = clock.now_ns()
    deaths.write_deaths(house, (now - 5, now - 3))
    assert deaths.read_deaths(house, NS_PER_S) == (now - 5, now - 3)


def test_deaths_of_another_boot_are_aged_by_the_wall_clock(house: Folders) -> None:
    window = 60 * NS_PER_S
    now = clock.now_ns()
    deaths.write_deaths(house, (now - 10 * NS_PER_S,))
    path = house.state / "budget.json"
    stored = json.loads(path.read_text())
    stored["boot_id"] = "another"
    stored["deaths"][0]["monotonic_ns"] = 1 << 60
    path.write_text(json.dumps(stored))
    (age,) = (clock.now_ns() - at for at in deaths.read_deaths(house, window))
    assert 10 * NS_PER_S <= age < window
    stored["deaths"][0]["wall_ns"] = 1 << 62  # a clock that was wrong then
    path.write_text(json.dumps(stored))
    (at,) = deaths.read_deaths(house, window)
    assert at <= clock.now_ns()


@pytest.mark.parametrize(
    "content", ["", "{}", '{"deaths": 5}', '{"deaths": [1, {"monotonic_ns": "x"}, null]}']
)
def test_a_damaged_budget_is_an_empty_one(house: Folders, content: str) -> None:
    (house.state / "budget.json").write_text(content)
    assert deaths.read_deaths(house, NS_PER_S) == ()


# ---- logs and ids ----


def test_a_log_is_rotated_at_its_bound_and_the_oldest_goes(tmp_path: Path) -> None:
    path = tmp_path / "log"
    for number in range(6):
        path.write_bytes(b"%d" % number + b"x" * logs.LOG_BYTES_MAX)
        logs.rotate(path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log.1", "log.2", "log.3"]
    assert [(tmp_path / f"log.{n}").read_bytes()[:1] for n in (1, 2, 3)] == [b"5", b"4", b"3"]


def test_a_log_line_can_not_be_forged_and_a_lost_one_harms_nothing(tmp_path: Path) -> None:
    log = logs.LogFile(tmp_path / "log")
    log.append({"text": 'a\n{"kind": "phase"}', "path": tmp_path})
    assert len((tmp_path / "log").read_text().splitlines()) == 1
    (tmp_path / "log").unlink()
    (tmp_path / "log").mkdir()
    log.append({"text": "lost"})


def test_ids_sort_by_time_and_say_their_version() -> None:
    made = [ids.new_id() for _ in range(100)]
    assert len(set(made)) == 100
    assert all(one[14] == "7" and one[19] in "89ab" for one in made)
    assert sorted(one[:13] for one in made) == [one[:13] for one in made]
