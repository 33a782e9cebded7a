"""The notify socket: what the core's beacon says, the guard's heartbeat room understands."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from core.guarded.beacon import KEPT_MAX, Beacon
from core.guarded.control import VERSION
from hardcore.host import notify
from hardcore.host.notify import NotifySocket, Tally
from hardcore.model.observations import StoreFault
from hardcore.sentinel.heartbeat import CONTROL_VERSION, NOTICE_BYTES_MAX, Notice, SpareNotice, read_notice

HASH = "ab" * 32
READY = Notice(ready=True, epoch=7, seq=1234, hash=HASH, proof="witness", tail=12)


@pytest.fixture(params=["path", "abstract"])
def ear(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[socket.socket, str]]:
    """A manager's socket and its name as `NOTIFY_SOCKET` would say it."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as listening:
        name = f"@fieldstack-test-{os.getpid()}" if request.param == "abstract" else str(tmp_path / "notify")
        listening.bind("\0" + name[1:] if name.startswith("@") else name)
        yield listening, name


def heard(ear: socket.socket) -> list[object]:
    """Everything that waits on the socket, read as the guard reads it."""
    notices: list[object] = []
    while True:
        try:
            notices.append(read_notice(ear.recv(NOTICE_BYTES_MAX + 1)))
        except BlockingIOError:
            return notices


def test_both_sides_speak_one_version_of_the_control_socket() -> None:
    assert VERSION == CONTROL_VERSION


def test_every_word_of_the_beacon_is_understood(ear: tuple[socket.socket, str]) -> None:
    listening, name = ear
    beacon = Beacon(name)
    beacon.spare("0123456789abcdef", 2, 4, migrates=True)
    beacon.epoch_raised(7)
    beacon.extend(2_000_000)
    beacon.ready(7, 1234, HASH, "witness", 12)
    beacon.watchdog()
    beacon.fence_blocked()
    beacon.term_from(4321)
    beacon.verified(1234)
    beacon.unsound("event 5 is\nodd. " + "말" * 1000)
    beacon.stopping()
    beacon.close()
    assert heard(listening) == [
        Notice(spare=SpareNotice("0123456789abcdef", 2, 4, migrates=True)),
        Notice(epoch=7),
        Notice(extend_usec=2_000_000),
        READY,
        Notice(watchdog=True),
        Notice(fence_blocked=True),
        Notice(term_pid=4321),
        Notice(verified_seq=1234),
        Notice(unsound=("event 5 is odd. " + "말" * 1000)[:400]),
        Notice(stopping=True),
    ]


def test_what_must_not_get_lost_is_told_to_the_next_listener_in_order(tmp_path: Path) -> None:
    name = str(tmp_path / "notify")
    beacon = Beacon(name)
    beacon.epoch_raised(7)
    beacon.watchdog()
    beacon.extend(1)
    beacon.ready(7, 1234, HASH, "witness", 12)
    assert not beacon.resend()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as listening:
        listening.bind(name)
        assert beacon.resend()
        beacon.watchdog()
        assert heard(listening) == [Notice(epoch=7), READY, Notice(watchdog=True)]
    beacon.close()


def test_a_full_socket_blocks_nobody_and_loses_no_fact(tmp_path: Path) -> None:
    name = str(tmp_path / "notify")
    beacon = Beacon(name)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as listening:
        listening.bind(name)
        for _ in range(10_000):
            beacon.watchdog()
        beacon.ready(7, 1234, HASH, "witness", 12)
        assert not beacon.resend()
        assert set(heard(listening)) == {Notice(watchdog=True)}
        beacon.watchdog()
        assert heard(listening) == [READY, Notice(watchdog=True)]
    beacon.close()


def test_a_flood_while_nobody_listens_is_bounded_and_keeps_what_came_first(tmp_path: Path) -> None:
    name = str(tmp_path / "notify")
    beacon = Beacon(name)
    beacon.epoch_raised(7)
    for pid in range(1, 1000):
        beacon.term_from(pid)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as listening:
        listening.bind(name)
        # Its buffer may be shorter than what is kept; then it takes more than one go.
        told: list[object] = []
        while not beacon.resend():
            told += heard(listening)
        told += heard(listening)
    assert told[:2] == [Notice(epoch=7), Notice(term_pid=1)]
    assert len(told) == KEPT_MAX
    beacon.close()


def test_without_an_address_every_word_is_nothing() -> None:
    beacon = Beacon(None)
    beacon.ready(7, 1234, HASH, "witness", 12)
    beacon.watchdog()
    assert beacon.resend()
    beacon.close()


def test_a_closed_beacon_keeps_silent(ear: tuple[socket.socket, str]) -> None:
    listening, name = ear
    beacon = Beacon(name)
    beacon.close()
    beacon.epoch_raised(1)
    beacon.close()
    assert heard(listening) == []


STRANGER = """
import array, socket, sys
handed = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", [0, 1]))]
with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as mouth:
    for _ in range(int(sys.argv[2])):
        mouth.sendmsg([b"READY=1"], handed, 0, sys.argv[1])
"""


def test_a_stranger_is_known_by_the_number_that_the_kernel_vouches_for_and_can_hand_us_no_descriptors(
    tmp_path: Path,
) -> None:
    argv = [sys.executable, "-c", STRANGER, str(tmp_path / "notify"), "3"]
    with closing(NotifySocket(tmp_path / "notify", NOTICE_BYTES_MAX)) as ear:
        before = len(list(Path("/proc/self/fd").iterdir()))
        with subprocess.Popen(argv) as stranger:
            assert stranger.wait() == 0
        assert [pid for pid, _ in ear.waiting()] == [stranger.pid] * 3
        assert len(list(Path("/proc/self/fd").iterdir())) == before


def test_a_flood_is_told_at_once_and_then_seldom_with_its_number() -> None:
    tally = Tally()
    said = [tally.count(at_ns) for at_ns in range(1000)]
    assert said == [1] + [0] * 999
    assert tally.count(notify.TELL_EVERY_NS) == 1000


@pytest.mark.parametrize("fault", list(StoreFault))
def test_what_a_core_says_of_its_store_is_understood(fault: StoreFault) -> None:
    assert read_notice(f"X_STORE={fault}".encode()) == Notice(store=fault)


def test_a_core_that_serves_reads_only_says_that_it_has_proven_nothing() -> None:
    said = f"READY=1\nX_EPOCH=7\nX_SEQ=1234\nX_HASH={HASH}\nX_PROOF=none\nX_TAIL=0".encode()
    assert read_notice(said) == Notice(ready=True, epoch=7, seq=1234, hash=HASH, proof="none", tail=0)
