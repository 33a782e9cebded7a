"""A data folder without room: what is there is served, nothing is taken that can't be kept, and room brings it back."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from core.journal.ballast import BALLAST_BYTES
from tests.integration.conftest import MakeHouse
from tests.integration.house import House
from tests.waiting import until

UNSHARE = shutil.which("unshare")
MOUNT = 'mount -t tmpfs -o size=96m,mode=700 none "$1" && exec "$2" -m hardcore.cli --data "$1" up --port 0'


def own_mounts() -> bool:
    argv = [UNSHARE or "unshare", "--mount", "mount", "-t", "tmpfs", "none", "/mnt"]
    return UNSHARE is not None and subprocess.run(argv, capture_output=True, check=False).returncode == 0


pytestmark = pytest.mark.skipif(not own_mounts(), reason="no mounts of one's own here: that needs root")


def begin_on_a_small_disk(house: House) -> Path:
    """Start it with its data on a file system of 96 MiB that only it sees; return the way in from outside."""
    house.data.mkdir()
    argv = [UNSHARE or "unshare", "--mount", "sh", "-c", MOUNT, "sh", str(house.data), sys.executable]
    house.begin_as(argv)
    status = house.running()
    return Path(f"/proc/{status['sentinel']['pid']}/root{house.data}")


def fill(disk: Path) -> None:
    with (disk / "filler").open("wb", buffering=0) as file:
        for size in (65536, 4096, 512):
            try:
                while True:
                    file.write(b"x" * size)
            except OSError:
                continue


def test_without_room_the_serving_core_reads_only_and_takes_writes_again_once_there_is_some(
    new_house: MakeHouse,
) -> None:
    house = new_house()
    disk = begin_on_a_small_disk(house)
    house.open_accounts()
    assert house.book("before-the-disk-was-full").status == 201
    core = house.status()["core"]["pid"]
    fill(disk)
    house.until(lambda s: s["safe"] == "DISK_FULL", "the core to read only")
    refused = house.book("no-room")
    assert (refused.status, refused.outcome) == (503, "not_done")
    assert house.book("before-the-disk-was-full").headers.get("idempotent-replayed") == "true"
    (disk / "filler").unlink()
    house.until(lambda s: s["safe"] is None and s["state"] == "OPERATIONAL", "the core to take writes")
    assert house.book("no-room").status == 201
    assert house.status()["core"]["pid"] == core


def with_ballast(disk: Path) -> Path:
    """Wait until the serving core has laid it down."""
    ballast = disk / "ballast"
    until(lambda: ballast.exists() and ballast.stat().st_size == BALLAST_BYTES, "the ballast to be laid down")
    return ballast


def test_the_ballast_pays_for_the_fence_of_a_full_disk_and_is_laid_down_again_when_there_is_room(
    new_house: MakeHouse,
) -> None:
    house = new_house()
    disk = begin_on_a_small_disk(house)
    house.open_accounts()
    assert house.book("before-the-disk-was-full").status == 201
    ballast = with_ballast(disk)
    epoch = house.status()["core"]["epoch"]
    fill(disk)
    house.hit("core")
    status = house.until(lambda s: s["core"]["ready"] and s["core"]["epoch"] == epoch + 1, "a fenced core")
    assert not ballast.exists()
    known = house.book("before-the-disk-was-full")
    assert (known.status, known.headers.get("idempotent-replayed")) == (201, "true"), (
        "it may say so: it has fenced"
    )
    (disk / "filler").unlink()
    house.until(lambda s: s["safe"] is None and s["state"] == "OPERATIONAL", "the core to take writes")
    assert house.book("room-again").status == 201
    assert house.status()["core"]["pid"] == status["core"]["pid"]
    house.hit("core")
    house.running()
    with_ballast(disk)
    assert sorted(house.booked()) == ["before-the-disk-was-full", "room-again"]


def test_without_room_or_ballast_at_the_fence_a_core_is_started_to_read_only_until_there_is_some(
    new_house: MakeHouse,
) -> None:
    house = new_house()
    disk = begin_on_a_small_disk(house)
    house.open_accounts()
    assert house.book("before-the-disk-was-full").status == 201
    epoch = house.status()["core"]["epoch"]
    with_ballast(disk).unlink()
    fill(disk)
    house.hit("core")
    status = house.until(lambda s: s["safe"] == "DISK_FULL" and s["core"]["ready"], "a core that reads only")
    assert (status["state"], status["core"]["epoch"]) == ("SAFE_MODE", epoch)
    assert house.booked() == ["before-the-disk-was-full"]
    assert house.book("no-room").status == 503
    (disk / "filler").unlink()
    status = house.until(lambda s: s["safe"] is None and s["core"]["ready"], "a core that writes")
    assert status["core"]["epoch"] > epoch
    house.running()
    assert house.booked() == ["before-the-disk-was-full"]
    assert house.book("room-again").status == 201


def test_a_guard_comes_back_on_a_full_disk(new_house: MakeHouse) -> None:
    house = new_house()
    disk = begin_on_a_small_disk(house)
    fill(disk)
    sentinel = house.hit("sentinel")
    house.until(lambda s: s["sentinel"]["pid"] != sentinel.pid, "another sentinel")
    status = house.until(lambda s: s["safe"] == "DISK_FULL" and s["core"]["ready"], "a core that reads only")
    assert status["state"] == "SAFE_MODE"
    refused = house.order("down")
    assert (refused["ok"], refused["code"]) == (False, "not-stored")
    disk = Path(f"/proc/{status['sentinel']['pid']}/root{house.data}")
    (disk / "filler").unlink()
    assert house.order("down")["ok"]
    assert house.launcher is not None
    assert house.launcher.wait(20) == 0
