"""Evidence that the disk has no room for: named, bounded, and in nobody's way."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from postmortem import bundle
from tests.integration.test_full_disk import UNSHARE, own_mounts

pytestmark = pytest.mark.skipif(not own_mounts(), reason="no mounts of one's own here: that needs root")

MOUNT = 'mount -t tmpfs -o size=64k,mode=700 none "$1/incidents" && exec "$2" -c "$3" "$1" "$4"'
TAKE = """
import asyncio, json, os, signal, subprocess, sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from hardcore.host.recorder import make_page
from hardcore.snapshot import stacks, writer
from hardcore.snapshot.image import ImageLimits
from hardcore.snapshot.subject import Subject

place = Path(sys.argv[1])
make_page(place / "page", "abcdef0123456789", "b" * 36)
core = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
pidfd = os.pidfd_open(core.pid)
shelter = place / "shelter" if sys.argv[2] == "sheltered" else None
subject = Subject(
    core.pid, pidfd, "abcdef0123456789", place / "page", (), "incident-1", place / "incidents", place, shelter=shelter
)
try:
    with ThreadPoolExecutor(4) as pool:
        image = ImageLimits(5_000, 1 << 30)
        taken = asyncio.run(writer.take_live(subject, 10_000, pool, stacks.find_tools(), image=image))
    state = Path(f"/proc/{core.pid}/stat").read_text().rpartition(")")[2].split()[0]
    signal.pidfd_send_signal(pidfd, signal.SIGKILL)
finally:
    core.kill()
    core.wait()
print(json.dumps({
    "failed": type(taken).__name__, "reason": taken.reason, "page": taken.page is not None, "state": state,
    "kept": taken.kept.name, "steps": [name for name, _ in taken.steps], "left": os.listdir(place / "incidents"),
}))
"""


def take(place: Path, how: str) -> dict[str, Any]:
    (place / "incidents").mkdir()
    argv = [UNSHARE or "unshare", "--mount", "sh", "-c", MOUNT, "sh", str(place), sys.executable, TAKE, how]
    done = subprocess.run(argv, capture_output=True, text=True, timeout=55, check=False)
    assert done.returncode == 0, done.stderr
    told: dict[str, Any] = json.loads(done.stdout)
    assert told["failed"] == "EvidenceFailed"
    assert told["reason"].startswith("the evidence could not be written: no room on the disk")
    assert told["page"], "what was read reaches the next core all the same"
    assert told["state"] == "T", "ready to be killed"
    assert told["left"] == [], "the room is given back"
    return told


def test_a_full_disk_is_named_hands_the_page_on_and_leaves_no_half_bundle(tmp_path: Path) -> None:
    told = take(tmp_path, "alone")
    assert (told["kept"], told["steps"]) == ("NOWHERE", ["frozen"]), "nothing is told as taken that is lost"


def test_evidence_that_a_full_disk_refuses_lies_in_the_shelter_and_is_told_as_taken(tmp_path: Path) -> None:
    told = take(tmp_path, "sheltered")
    assert (told["kept"], told["steps"]) == ("ELSEWHERE", ["frozen", "dumped"])
    assert bundle.verify_bundle(tmp_path / "shelter" / "incident-1") == []
    assert (tmp_path / "shelter" / "incident-1" / "recorder.bin").exists()
