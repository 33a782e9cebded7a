"""The guard's hands work side by side: what one of them writes or removes must not trip another."""

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

from hardcore.host import files, leftovers, lives
from hardcore.host.folders import Folders

WRITERS = 4
ROUNDS = 50


def test_a_page_that_vanishes_while_old_lives_are_swept_keeps_no_core_from_being_started(
    tmp_path: Path,
) -> None:
    folders = Folders(tmp_path, tmp_path)
    (tmp_path / "recorder-gone").symlink_to(
        tmp_path / "nowhere"
    )  # listed, and not there when it is looked at
    for nonce in ("a", "b", "living"):
        (tmp_path / f"recorder-{nonce}").touch()
    lives.sweep(folders, {"living"}, keep=1)
    assert (tmp_path / "recorder-living").exists()
    assert sum((tmp_path / f"recorder-{nonce}").exists() for nonce in ("a", "b")) == 1


def test_the_page_of_a_spare_never_takes_the_place_of_one_that_bears_witness(tmp_path: Path) -> None:
    folders = Folders(tmp_path, tmp_path)
    wrote, waited = (lives.conceive(folders, number) for number in (1, 2))
    with folders.recorder(wrote.nonce).open("r+b") as page:
        page.seek(256 + 72)  # its epoch: `docs/wires.md`, section 3
        page.write((7).to_bytes(8, "little"))
    os.utime(folders.recorder(wrote.nonce), (1, 1))
    lives.sweep(folders, set(), keep=1)
    assert folders.recorder(wrote.nonce).exists()
    assert not folders.recorder(waited.nonce).exists()
    for life in (wrote, waited):
        life.discard()


def test_drafts_of_dead_writers_are_swept_and_those_of_living_ones_are_not(tmp_path: Path) -> None:
    folders = Folders(tmp_path, tmp_path / "run")
    with subprocess.Popen([sys.executable, "-c", ""]) as gone:
        pass
    for folder in (folders.data, folders.state, folders.run):
        folder.mkdir(exist_ok=True)
        for name in (
            f".a.json.{gone.pid}.tmp",
            f".a.json.{threading.get_native_id()}.tmp",
            "b.tmp",
            ".c.tmp",
        ):
            (folder / name).touch()
    leftovers.sweep_drafts(folders)
    for folder in (folders.data, folders.state, folders.run):
        left = {path.name for path in folder.iterdir() if path.is_file()}
        assert left == {f".a.json.{threading.get_native_id()}.tmp", "b.tmp", ".c.tmp"}


def test_writers_of_one_file_do_not_take_each_others_draft(tmp_path: Path) -> None:
    path = tmp_path / "budget.json"
    faults: list[Exception] = []

    def write(number: int) -> None:
        try:
            for _ in range(ROUNDS):
                files.write_json(path, {"number": number}, durable=False)
        except OSError as error:
            faults.append(error)

    threads = [threading.Thread(target=write, args=(number,)) for number in range(WRITERS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not faults
    assert json.loads(path.read_text())["number"] in range(WRITERS)
    assert list(tmp_path.iterdir()) == [path]
