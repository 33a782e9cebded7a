"""A disk that takes no writes any more: what is there is served, nobody is restarted for it, and a person is told.

The disk is a real ext4 in a file, mounted where only the house sees it, and turned read-only the way ext4 does that
itself after an error (errors=remount-ro): the mount is still called writable, and every write is refused.
"""

import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import pytest

from tests.integration.conftest import MakeHouse
from tests.integration.house import Answer, House
from tests.integration.lone_core import ready, started
from tests.integration.test_full_disk import UNSHARE
from tests.waiting import until

IMAGE_BYTES: Final = 64 << 20
REASON: Final = "DISK_READ_ONLY"
MKFS, STRACE = shutil.which("mkfs.ext4"), shutil.which("strace")
MOUNT = 'mount -o "$2" "$1.img" "$1" && shift 2 && exec "$@"'
PWRITE64: Final = "18 "  # how /proc/PID/syscall begins in it on x86-64


def mounted(data: Path, options: str, *argv: str) -> list[str]:
    """The command line that does something with an image mounted on a folder, in a namespace of its own."""
    return [UNSHARE or "unshare", "--mount", "sh", "-c", MOUNT, "sh", str(data), options, *argv]


def make_image(data: Path) -> None:
    data.mkdir()
    with data.with_name(f"{data.name}.img").open("wb") as image:
        image.truncate(IMAGE_BYTES)
        subprocess.run([MKFS or "mkfs.ext4", "-q", "-F", image.name], check=True)


def own_images(folder: Path) -> bool:
    make_image(folder / "try")
    argv = mounted(folder / "try", "loop", "mount", "-o", "remount,abort", str(folder / "try"))
    return subprocess.run(argv, capture_output=True, check=False).returncode == 0


@pytest.fixture(scope="module", autouse=True)
def _images(tmp_path_factory: pytest.TempPathFactory) -> None:
    if MKFS is None or UNSHARE is None or not own_images(tmp_path_factory.mktemp("images")):
        pytest.skip("no ext4 of one's own here: that needs root and loop devices")


class Disk:
    """The file system that a house has to itself, as long as a process of the house lives."""

    def __init__(self, house: House) -> None:
        self.house = house
        make_image(house.data)

    def begin(self, *options: str, mount: str = "loop") -> dict[str, Any]:
        """Start the house on it and wait until a core serves."""
        argv = [sys.executable, "-m", "hardcore.cli", "--data", str(self.house.data), "up", "--port", "0"]
        self.house.begin_as(mounted(self.house.data, mount, *argv, *options))
        status = self.house.until(lambda s: s["core"]["ready"] and s["gateway"]["pid"], "a core to serve")
        self.house.url = status["url"]
        return status

    def inside(self, *argv: str) -> "subprocess.CompletedProcess[str]":
        """Do something where the disk can be seen."""
        seen_by = self.house.status()["sentinel"]["pid"]
        command = ["nsenter", f"--mount=/proc/{seen_by}/ns/mnt", *argv]
        return subprocess.run(
            command, env=self.house.environment(), capture_output=True, text=True, timeout=50, check=False
        )

    def cli(self, *words: str) -> "subprocess.CompletedProcess[str]":
        return self.inside(sys.executable, "-m", "hardcore.cli", "--data", str(self.house.data), *words)

    def break_off(self) -> None:
        """Have the file system give up writing, as after an error."""
        done = self.inside("mount", "-o", "remount,abort", str(self.house.data))
        assert done.returncode == 0, done.stderr


@pytest.fixture
def disk(new_house: MakeHouse) -> Disk:
    """The disk of a house that runs and has one booking."""
    house = new_house(max_restart_count=1)
    made = Disk(house)
    made.begin("--policy", str(house.settle_policy()))
    house.running()
    house.open_accounts()
    assert house.book("before").status == 201
    return made


def reads_only(house: House, which: Callable[[dict[str, Any]], object] = lambda _: True) -> dict[str, Any]:
    """Wait until a core reads only because of the disk and has lasted; see that it does."""
    status = house.until(
        lambda s: (
            s["safe"] == REASON and s["core"]["ready"] and s["phase"] in {"RUNNING", "SUSPECT"} and which(s)
        ),
        "a core that reads only",
    )
    assert (status["state"], status["waits_for"]) == ("SAFE_MODE", None)
    assert house.booked() == ["before"]
    refused = house.book("refused")
    assert (refused.status, refused.body["type"], refused.outcome) == (503, "/problems/safe-mode", "not_done")
    return status


def ends_when_asked(house: House) -> None:
    assert house.launcher is not None
    house.launcher.terminate()
    assert house.launcher.wait(30) == 0


def test_a_disk_that_turns_read_only_ends_nobody_and_is_told_everywhere(disk: Disk) -> None:
    house = disk.house
    core = house.status()["core"]["pid"]
    disk.break_off()
    assert (refused := house.book("refused")).outcome == "not_done", refused
    status = reads_only(house, lambda s: s["incident"])
    assert (status["core"]["pid"], status["budget"]["used"]) == (core, 0)
    shown = disk.cli("status").stdout
    assert REASON in shown
    assert "Make it writable" in shown
    doctor = disk.cli("doctor")
    assert doctor.returncode == 1
    assert "EROFS" in doctor.stdout
    until(lambda: status["incident"][:8] in disk.cli("incidents").stdout, "the incident to be on record")
    assert disk.cli("incidents", "show", status["incident"]).returncode == 0
    ends_when_asked(house)


def test_a_core_that_dies_on_a_read_only_disk_is_followed_by_one_that_reads(disk: Disk) -> None:
    house = disk.house
    epoch = house.status()["core"]["epoch"]
    disk.break_off()
    core = house.hit("core")
    status = reads_only(house, lambda s: s["core"]["pid"] != core.pid)
    assert (status["core"]["epoch"], status["budget"]["used"]) == (epoch, 1), "the first death, and no more"
    ends_when_asked(house)


def test_a_guard_comes_back_on_a_read_only_disk(disk: Disk) -> None:
    house = disk.house
    disk.break_off()
    reads_only(house)
    sentinel = house.hit("sentinel")
    status = reads_only(house, lambda s: s["sentinel"]["pid"] != sentinel.pid)
    gateway = house.hit("gateway")
    house.until(lambda s: s["gateway"]["pid"] not in {0, None, gateway.pid}, "another gateway")
    assert reads_only(house)["core"]["pid"] == status["core"]["pid"]
    ends_when_asked(house)


@contextmanager
def held_back(house: House, *injected: str) -> Iterator[None]:
    """Trace the core, with something done to its system calls."""
    pid = str(house.status()["core"]["pid"])
    argv = [STRACE or "strace", "-f", "-q", "-o", "/dev/null", "-p", pid]
    with subprocess.Popen([*argv, *(f"--inject={one}" for one in injected)]) as tracer:
        try:
            traced = Path(f"/proc/{pid}/status")
            until(lambda: f"TracerPid:\t{tracer.pid}" in traced.read_text(), "the core to be traced")
            yield
        finally:
            tracer.terminate()


def is_writing(pid: int) -> bool:
    """Whether a thread is held in the very call that writes to the log."""
    calls = (task / "syscall" for task in Path(f"/proc/{pid}/task").iterdir())
    return any(call.read_text().startswith(PWRITE64) for call in calls)


@pytest.mark.skipif(STRACE is None, reason="no strace here")
def test_a_commit_that_meets_the_refusal_is_unknown_and_the_next_core_reads(disk: Disk) -> None:
    house = disk.house
    core = house.status()["core"]["pid"]
    answers: list[Answer] = []
    asking = threading.Thread(target=lambda: answers.append(house.book("met")))
    with held_back(house, "pwrite64:delay_enter=2000000"):
        asking.start()
        until(lambda: is_writing(core), "the core to be in the middle of its commit")
        disk.break_off()
        asking.join(30)
    assert answers[0].outcome == "unknown", answers
    status = reads_only(house, lambda s: s["core"]["pid"] != core)
    assert status["budget"]["used"] <= 1
    assert house.ask("GET", "/api/ledger/commands/met").body["outcome"] != "done", "nobody knows"
    ends_when_asked(house)


@pytest.mark.in_a_file
@pytest.mark.skipif(STRACE is None, reason="no strace here")
def test_an_error_that_comes_once_costs_one_death_and_nothing_else(new_house: MakeHouse) -> None:
    house = new_house().up()
    house.open_accounts()
    assert house.book("before").status == 201
    core = house.status()["core"]["pid"]
    with held_back(house, "fsync,fdatasync:error=EIO:when=1"):
        assert house.book("once").outcome == "unknown"
        house.until(lambda s: s["core"]["ready"] and s["core"]["pid"] != core, "another core")
    assert house.closed(1)["diagnosis"] == "COMMIT_FAILED"
    assert house.running()["state"] == "OPERATIONAL"
    assert house.book("once").status == 201
    assert sorted(house.booked()) == ["before", "once"]


@pytest.mark.parametrize("end", ["killed", "asked to end"])
def test_a_disk_that_is_mounted_read_only_from_the_start_is_served_as_it_lies_there(
    disk: Disk, end: str
) -> None:
    house = disk.house
    if end == "killed":
        house.end()
    else:
        ends_when_asked(house)
    disk.begin(mount="loop,ro")
    assert reads_only(house)["budget"]["used"] == 0
    ends_when_asked(house)


def test_a_log_whose_index_is_gone_can_not_be_read_there_and_the_disk_is_named(tmp_path: Path) -> None:
    """SQLite reads a log through an index beside it, which it would have to make: an honest no."""
    data = tmp_path / "data"
    make_image(data)
    with started(data, before=mounted(data, "loop"), sock=tmp_path / "first") as core:
        assert ready(core).open("cash").status == 201
    lost = mounted(data, "loop", "rm", str(data / "ledger.db-shm"))
    subprocess.run(lost, check=True)
    again = mounted(data, "loop,ro")
    with started(data, before=again, sock=tmp_path / "second", HARDCORE_SAFE=REASON) as core:
        assert core.ends_with() == 73
        assert "read-only (and its log can't be read without a write" in core.said()


@pytest.mark.in_a_file
@pytest.mark.skipif(STRACE is None, reason="no strace here")
@pytest.mark.parametrize(
    ("failing", "code"), [("fdatasync,fsync:error=EIO", 73), ("fdatasync:error=EIO:when=1", 74)]
)
def test_a_core_that_can_not_fence_asks_the_disk_before_it_blames_the_store(
    tmp_path: Path, failing: str, code: int
) -> None:
    """Both fail at the fence's COMMIT; only where a small write of its own fails too it is the disk."""
    data = tmp_path / "data"
    with started(data, sock=tmp_path / "first") as core:
        assert ready(core).open("cash").status == 201
    traced = [STRACE or "strace", "-D", "-f", "-q", "-o", "/dev/null", f"--inject={failing}"]
    with started(data, before=traced, sock=tmp_path / "second") as core:
        assert core.ends_with() == code
        assert ("EIO" in core.said()) == (code == 73), core.said()
    assert {path.name for path in data.iterdir()} >= {"ledger.db", "ledger.lock"}
    assert not (data / ".core-probe").exists()
