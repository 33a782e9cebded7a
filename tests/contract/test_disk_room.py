"""How much room a disk has: the core and its guard count alike, or one would try what the other refuses."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from core.guarded import privilege
from core.journal import room
from hardcore.host import disk
from tests.integration.lone_core import ROOT

BLOCK = 4096
#: Becomes nobody, and then the root of a namespace of users in which nobody is called root.
CONTAINED = """
import ctypes, os, pathlib
from core.guarded import privilege
from hardcore.host import disk
if os.geteuid() == 0:
    os.setresuid(65534, 65534, 65534)
nobody, libc = os.geteuid(), ctypes.CDLL(None)
libc.prctl(4, 1)  # PR_SET_DUMPABLE: whoever changed his user may not write his own map otherwise
assert libc.unshare(0x10000000) == 0  # CLONE_NEWUSER
pathlib.Path("/proc/self/uid_map").write_text(f"0 {nobody} 1")
assert os.geteuid() == 0
print(privilege.has_reserve(), disk.has_reserve())
"""


def told(blocks: int, free: int, available: int) -> os.statvfs_result:
    return os.statvfs_result((BLOCK, BLOCK, blocks, free, available, 0, 0, 0, 0, 255))


@pytest.mark.parametrize(
    ("seen", "reserve_is_ours", "free_bytes"),
    [
        (told(100, 7, 2), False, 2 * BLOCK),
        (told(100, 7, 2), True, 7 * BLOCK),
        (told(100, 5, 0), False, 0),
        (told(100, 5, 0), True, 5 * BLOCK),
        (told(0, 0, 0), False, None),
        (told(0, 0, 0), True, None),
    ],
)
def test_what_is_free_is_what_this_process_may_write_where_it_is_told_at_all(
    seen: os.statvfs_result, reserve_is_ours: bool, free_bytes: int | None
) -> None:
    assert room.free_bytes(seen, reserve_is_ours=reserve_is_ours) == free_bytes
    assert disk.told_free_bytes(seen, reserve_is_ours=reserve_is_ours) == free_bytes


def test_both_know_alike_whether_what_is_kept_back_is_theirs() -> None:
    assert privilege.has_reserve() == disk.has_reserve()


def test_the_root_of_a_container_with_users_of_its_own_has_no_reserve() -> None:
    asked = subprocess.run(
        [sys.executable, "-c", CONTAINED], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if asked.returncode:
        pytest.skip(f"no users of one's own here: {asked.stderr}")
    assert asked.stdout.split() == ["False", "False"]


def test_a_disk_that_tells_nothing_of_its_room_is_written_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "statvfs", lambda _path: told(0, 0, 0))
    assert room.Room(tmp_path, lambda: 0).fault() is None
    guard = disk.DiskWatch(tmp_path, tmp_path)
    facts = guard.look(0)
    while facts is None:
        facts = guard.look(0)
    assert (facts.fault, facts.read_only) == ("", False)
    assert facts.free_bytes > room.ROOM_BYTES_MIN
