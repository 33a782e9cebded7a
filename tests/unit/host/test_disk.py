"""The disk under the ledger: its room, its refusals by name, its stalls by their length."""

import errno
import os
import shutil
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from hardcore.host import clock, disk
from hardcore.host.disk import DiskWatch
from hardcore.model.looks import DiskFacts
from tests.waiting import WAIT_S, until


def looked(watch: DiskWatch, *, now: bool = False) -> DiskFacts:
    found = until(lambda: watch.look(clock.now_ns(), now=now), "an answer of the disk")
    assert found is not None, "as above"
    return found


def filled(path: Path) -> Path:
    """Write a file until the disk is full."""
    fd = os.open(path, os.O_WRONLY | os.O_CREAT)
    try:
        while os.write(fd, bytes(4096)):
            pass
    except OSError as error:
        assert error.errno == errno.ENOSPC  # noqa: PT017  # the error is what is wanted, and others are not
    finally:
        os.close(fd)
    return path


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 256 KiB of its own."""
    if os.geteuid() != 0 or shutil.which("mount") is None:
        pytest.skip("mounting needs the superuser")
    place = tmp_path / "small"
    place.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=256k", "small", str(place)], check=False)
    if mounted.returncode:
        pytest.skip("nothing can be mounted here")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def test_a_disk_that_is_well_has_room_and_takes_a_write_that_leaves_nothing(tmp_path: Path) -> None:
    facts = looked(DiskWatch(tmp_path, tmp_path))
    assert facts.free_bytes > 0
    assert facts.write_ns is not None
    assert (facts.read_only, facts.pending_ns, facts.fault) == (False, 0, "")
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_is_well_is_not_written_to_at_every_look_unless_that_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writes: list[Path] = []

    def write(path: Path) -> str:
        writes.append(path)
        return ""

    monkeypatch.setattr(disk, "write_once", write)
    watch = DiskWatch(tmp_path, tmp_path)
    first = looked(watch)
    assert looked(watch).write_ns == first.write_ns, "what the last write took stands until the next"
    assert len(writes) == 1
    looked(watch, now=True)
    assert len(writes) == 2


def test_a_write_that_failed_is_tried_again_at_the_next_look(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = iter(["EDQUOT", "EIO", ""])
    monkeypatch.setattr(disk, "write_once", lambda _path: next(answers))
    watch = DiskWatch(tmp_path, tmp_path)
    assert [looked(watch).fault for _ in range(3)] == ["EDQUOT", "EIO", ""]


def test_a_write_that_hangs_is_told_by_its_length_and_not_begun_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    let_go = threading.Event()
    begun: list[int] = []

    def hang(_path: Path) -> str:
        begun.append(1)
        let_go.wait(WAIT_S)
        return ""

    monkeypatch.setattr(disk, "PATIENCE_S", 0.01)
    monkeypatch.setattr(disk, "write_once", hang)
    watch = DiskWatch(tmp_path, tmp_path)
    try:
        first, second = looked(watch), looked(watch)
        assert first.write_ns is None
        assert second.pending_ns > first.pending_ns > 0
        assert len(begun) == 1
    finally:
        let_go.set()
    until(lambda: looked(watch).write_ns is not None, "the write to come back")


def test_a_full_disk_is_named_and_so_is_its_recovery(small_disk: Path) -> None:
    ballast = filled(small_disk / "ballast")
    watch = DiskWatch(small_disk, small_disk)
    facts = looked(watch)
    assert (facts.fault, facts.free_bytes) == ("ENOSPC", 0)
    ballast.unlink()
    until(lambda: not looked(watch).fault, "room")
    assert looked(watch).free_bytes > 0


def test_a_disk_that_may_only_be_read_is_named(small_disk: Path) -> None:
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    facts = looked(DiskWatch(small_disk, small_disk))
    assert facts.read_only
    assert facts.fault == "EROFS"


def test_a_folder_that_is_gone_is_a_named_fault_and_no_exception(tmp_path: Path) -> None:
    assert looked(DiskWatch(tmp_path / "gone", tmp_path / "gone")).fault == "ENOENT"


def test_what_a_writer_that_died_has_left_is_written_over(tmp_path: Path) -> None:
    path = tmp_path / disk.PROBE_NAME
    path.write_bytes(b"half")
    assert disk.write_once(path) == ""
    assert not path.exists()
