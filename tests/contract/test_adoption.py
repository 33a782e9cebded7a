"""Which of the processes that an earlier guard left is gone on with: the one that serves, and nothing in the middle."""

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from core.guarded.recorder import Recorder
from hardcore.host import clock, files, steps
from hardcore.host.folders import Folders
from hardcore.host.leftovers import Leftovers, find_leftovers
from hardcore.host.recorder import make_page

NONCE = "00000000000000a1"
OTHER = "00000000000000b2"


@dataclass
class Ground:
    """A run folder with cores in it."""

    folders: Folders
    living: "list[subprocess.Popen[bytes]]" = field(default_factory=list)

    def core(
        self, state: str = "READY", epoch: int = 7, says: str = "well", *, nonce: str = NONCE, **more: str
    ) -> "subprocess.Popen[bytes]":
        """Start a core and wait until it is there."""
        page = self.folders.recorder(nonce)
        make_page(page, nonce, clock.boot_id())
        environment = {
            "PYTHONPATH": str(Path(__file__).parents[2]),
            "HARDCORE_RECORDER": str(page),
            "HARDCORE_SOCKET": str(self.folders.core_socket(nonce)),
            "HARDCORE_CONTROL": str(self.folders.core_control(nonce)),
            **more,
        }
        argv = [sys.executable, "-m", "tests.contract.found_core", state, str(epoch), says]
        process = subprocess.Popen(argv, env=environment, stdout=subprocess.PIPE, start_new_session=True)
        self.living.append(process)
        assert process.stdout is not None
        assert process.stdout.readline() == b"there\n"
        return process

    def dead_page(self, epoch: int) -> None:
        """Leave the page of a core that is gone."""
        path = self.folders.recorder(OTHER)
        make_page(path, OTHER, clock.boot_id())
        recorder = Recorder.open(path)
        assert isinstance(recorder, Recorder), recorder
        recorder.set_epoch(epoch)
        recorder.close()


@pytest.fixture
def ground(tmp_path: Path) -> Iterator[Ground]:
    # Short, for the sockets in it, and of a name that no other has: leftovers are found by it.
    with tempfile.TemporaryDirectory(prefix="found-") as run:
        made = Ground(Folders(tmp_path / "data", Path(run)))
        yield made
        for process in made.living:
            process.kill()
            process.communicate()


def looked(ground: Ground, *, reads_only: bool = False) -> Leftovers:
    found = find_leftovers(ground.folders, adopt=True, reads_only=reads_only)
    for life in (*found.cores, *([found.adoptable] if found.adoptable else [])):
        life.let_go()
    return found


def test_the_one_core_that_serves_is_gone_on_with(ground: Ground) -> None:
    process = ground.core()
    found = looked(ground)
    assert found.adoptable is not None
    assert found.adoptable_page is not None
    assert (found.adoptable_page.pid, found.adoptable_page.beats.epoch) == (process.pid, 7)
    assert found.cores == ()


def test_a_core_that_says_nothing_at_the_moment_is_judged_by_the_watch(ground: Ground) -> None:
    ground.core(says="mute")
    assert looked(ground).adoptable is not None


@pytest.mark.parametrize("state", ["STARTING", "DRAINING", "STOPPING", "SPARE"])
def test_a_core_in_the_middle_of_something_is_ended(ground: Ground, state: str) -> None:
    ground.core(state)
    found = looked(ground)
    assert (found.adoptable, len(found.cores)) == (None, 1)


def test_a_core_behind_the_fence_is_ended_though_its_successor_is_dead(ground: Ground) -> None:
    ground.core(epoch=7)
    ground.dead_page(epoch=8)
    found = looked(ground)
    assert (found.adoptable, len(found.cores)) == (None, 1)


def test_of_two_cores_the_one_with_the_higher_epoch_goes_on_and_the_other_is_ended(ground: Ground) -> None:
    ground.core(epoch=7)
    successor = ground.core(epoch=8, nonce=OTHER)
    found = looked(ground)
    assert found.adoptable_page is not None
    assert found.adoptable_page.pid == successor.pid
    assert [life.nonce for life in found.cores] == [NONCE]


def test_a_core_that_has_raised_no_epoch_is_ended(ground: Ground) -> None:
    ground.core(epoch=0)
    assert looked(ground).adoptable is None


@pytest.mark.parametrize("how", ["was started to", "does now"])
def test_a_core_that_only_reads_is_ended(ground: Ground, how: str) -> None:
    if how == "was started to":
        ground.core(HARDCORE_SAFE="DISK_FULL")
    else:
        ground.core(says="safe")
    assert looked(ground).adoptable is None


def test_a_core_that_reads_only_because_a_person_wants_that_is_gone_on_with(ground: Ground) -> None:
    process = ground.core(says="obeying")
    found = looked(ground, reads_only=True)
    assert found.adoptable_page is not None
    assert (found.adoptable_page.pid, found.cores) == (process.pid, ())


def test_a_core_that_reads_only_for_a_reason_of_its_own_is_ended_also_where_a_person_wants_reads_only(
    ground: Ground,
) -> None:
    ground.core(says="safe")
    assert looked(ground, reads_only=True).adoptable is None


def test_a_core_that_the_guard_before_had_begun_to_end_is_ended(ground: Ground) -> None:
    ground.core()
    files.write_json(ground.folders.switch, {"step": "stop", "condemned": [NONCE]}, durable=False)
    found = looked(ground)
    assert (found.adoptable, len(found.cores)) == (None, 1)


@pytest.mark.parametrize("told", [None, 7, "everything", {"nonces": []}])
def test_a_damaged_word_about_who_was_given_up_on_is_none(ground: Ground, told: object) -> None:
    files.write_json(ground.folders.switch, {"condemned": told}, durable=False)
    assert steps.condemned(ground.folders) == frozenset()


def test_a_core_that_nothing_leads_to_any_more_is_ended(ground: Ground) -> None:
    ground.core()
    ground.folders.core_socket(NONCE).unlink()
    assert looked(ground).adoptable is None


def test_nothing_is_gone_on_with_where_nothing_is_wanted(ground: Ground) -> None:
    ground.core()
    found = find_leftovers(ground.folders)
    for life in found.cores:
        life.let_go()
    assert (found.adoptable, len(found.cores)) == (None, 1)


def test_a_page_that_names_another_process_is_no_proof_of_the_one_that_was_found(ground: Ground) -> None:
    ground.core()
    stranger = ground.core(nonce=OTHER)
    page = ground.folders.recorder
    page(NONCE).write_bytes(page(OTHER).read_bytes().replace(OTHER.encode(), NONCE.encode()))
    found = looked(ground)
    assert found.adoptable_page is not None
    assert found.adoptable_page.pid == stranger.pid
