"""A service manager above the launcher: it hands the listener over, is told how it goes, and nobody below hears of it."""

import contextlib
import os
import signal
import socket
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.integration.conftest import MakeHouse
from tests.integration.house import START_S, House
from tests.waiting import until

WATCHDOG_USEC = 600_000
#: What a manager does between fork and exec: the listener becomes descriptor 3, and the environment says so.
HAND_OVER = """
import os, socket, sys
address, notify, usec, *argv = sys.argv[1:]
listener = socket.create_server((address, 0)) if address else socket.socketpair()[0]
os.dup2(listener.fileno(), 3)
os.set_inheritable(3, True)
os.environ |= {"LISTEN_PID": str(os.getpid()), "LISTEN_FDS": "1", "LISTEN_FDNAMES": "ledger"}
os.environ |= {"NOTIFY_SOCKET": notify, "WATCHDOG_USEC": usec, "WATCHDOG_PID": str(os.getpid())}
os.execv(sys.executable, [sys.executable, "-m", "hardcore.cli", *argv])
"""


class Ears:
    """The manager's end of the notify socket: what was said so far, in order."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._socket.bind(str(path))
        self._said: list[str] = []

    @property
    def said(self) -> list[str]:
        with contextlib.suppress(BlockingIOError):
            while True:
                self._said.append(self._socket.recv(4096).decode())
        return self._said

    def close(self) -> None:
        self._socket.close()
        self.path.unlink()


@pytest.fixture
def ears() -> Iterator[Ears]:
    heard = Ears(Path(f"/tmp/hardcore-ears-{os.getpid()}"))
    yield heard
    heard.close()


def begin(house: House, ears: Ears, address: str = "127.0.0.1") -> None:
    words = ["--data", str(house.data), "up", "--policy", str(house.settle_policy())]
    argv = [sys.executable, "-c", HAND_OVER, address, str(ears.path), str(WATCHDOG_USEC), *words]
    house.begin_as(argv)


def test_a_manager_hands_its_listener_over_and_is_told_how_it_goes(new_house: MakeHouse, ears: Ears) -> None:
    house = new_house()
    begin(house, ears)
    assert house.launcher is not None
    until(lambda: "READY=1" in ears.said, "READY", START_S)
    house.running()
    assert house.ask("GET", "/livez").status == 200
    for pid in house.processes():
        told = Path(f"/proc/{pid}/environ").read_bytes()
        if pid != house.launcher.pid:
            assert not any(word in told for word in (b"\0LISTEN_", b"\0WATCHDOG_PID", bytes(ears.path)))

    until(lambda: "WATCHDOG=1" in ears.said, "a beat")
    # The sentinel's death is no reason for silence; standing still is one.
    sentinel = house.hit("sentinel")
    house.until(lambda s: s["sentinel"]["pid"] not in {None, sentinel.pid}, "another sentinel")
    beats = ears.said.count("WATCHDOG=1")
    until(lambda: ears.said.count("WATCHDOG=1") > beats + 1, "it to beat on")
    assert ears.said.count("READY=1") == 1

    house.launcher.send_signal(signal.SIGTERM)
    assert house.launcher.wait(START_S) == 0
    assert ears.said.count("STOPPING=1") == 1


@pytest.mark.parametrize("address", ["", "0.0.0.0"])
def test_a_socket_that_is_no_listener_on_this_machine_alone_is_refused(
    new_house: MakeHouse, ears: Ears, address: str
) -> None:
    house = new_house()
    begin(house, ears, address)
    assert house.launcher is not None
    assert house.launcher.wait(START_S) in {1, 2}
    assert "ListenStream" in house.said or "0.0.0.0" in house.said
    assert "READY=1" not in ears.said
