"""The units under a real systemd, in a process namespace of its own: the guard dies, and the same core serves on.

It needs the right to make namespaces, and a hierarchy of control groups that a systemd may have. The hardening of the
system's unit needs a machine that systemd mounts itself, so here the user's unit is run, which is the same without it.
"""

import contextlib
import json
import os
import shutil
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from hardcore import standing
from hardcore.control import client
from hardcore.host import files
from hardcore.host.folders import locate
from hardcore.opening import Opening
from hardcore.service_words import Place, units
from tests.waiting import until

SYSTEMD = Path("/lib/systemd/systemd")
BOOT = """mount -t proc proc /proc && mount -t tmpfs tmpfs /run && mkdir -p /run/systemd/system && exec env -i \
container=test PATH="$PATH" SYSTEMD_UNIT_PATH="$1:" {systemd} --system --unit=test.target --log-target=null \
--show-status=no"""
#: Nothing of this machine's own is waited for.
ALONE = "[Unit]\nDefaultDependencies=no\n"
COMMAND_S = 40.0
UNITS = frozenset({".scope", ".slice", ".mount", ".socket", ".service", ".swap", ".automount"})

pytestmark = pytest.mark.timeout(150)  # a systemd of its own, and three starts of a guard


@dataclass
class Manager:
    """A systemd that is PID 1 of a namespace."""

    pid: int
    data: Path
    port: int

    def ctl(self, *words: str) -> "subprocess.CompletedProcess[str]":
        argv = ["nsenter", "-t", str(self.pid), "-m", "-p", "--", "systemctl", *words]
        return subprocess.run(argv, capture_output=True, text=True, timeout=COMMAND_S, check=False)

    def hardcore(self, *words: str) -> "subprocess.CompletedProcess[str]":
        enter = ["nsenter", "-t", str(self.pid), "-m", "-p", "--"]
        argv = [*enter, sys.executable, "-I", "-m", "hardcore.cli", "--data", str(self.data), *words]
        return subprocess.run(argv, capture_output=True, text=True, timeout=COMMAND_S, check=False)

    def status(self) -> dict[str, Any]:
        """What the guard says at its door, which is the same file inside and outside."""
        try:
            return client.ask(locate(self.data).control, {"verb": "status"})
        except client.Unreachable:
            return {}

    def running(self) -> dict[str, Any]:
        found = until(self._settled, "the ledger to run", COMMAND_S)
        assert found is not None
        return found

    def _settled(self) -> dict[str, Any] | None:
        status = self.status()
        settled = status.get("phase") == "RUNNING" and status["incident"] is None
        return status if settled and status["gateway"]["pid"] else None

    def wanted(self) -> object:
        return files.read_json(self.data / "state" / "wanted.json").get("wanted", "UP")

    def shown(self, name: str) -> str:
        return self.ctl("show", "-p", name, "--value", "hardcore.service").stdout.strip()

    def state(self, kind: str) -> str:
        return self.ctl("show", "-p", "ActiveState", "--value", f"hardcore.{kind}").stdout.strip()

    def kill(self, pid: int) -> None:
        """Kill a process by its number inside."""
        argv = ["nsenter", "-t", str(self.pid), "-m", "-p", "--", "kill", "-KILL", str(pid)]
        subprocess.run(argv, timeout=COMMAND_S, check=True)


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[Manager]:
    if os.geteuid() != 0 or not SYSTEMD.exists() or not shutil.which("unshare"):
        pytest.skip("needs root, systemd and namespaces")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    folder, data = tmp_path / "units", tmp_path / "data"
    folder.mkdir()
    data.mkdir()
    for path, text in units(Place("hardcore", user=True), data, Opening(), port).items():
        # A user's units in a manager of the whole machine, which is asked without `--user`.
        (folder / path.name).write_text(text.replace("systemctl --user ", "systemctl "))
        (folder / f"{path.name}.d").mkdir()
        (folder / f"{path.name}.d" / "alone.conf").write_text(ALONE)
    (folder / "test.target").write_text(ALONE)
    (data / "failover_policy.json").write_text(
        json.dumps({"version": 1, "spare": False, "probation_ms": 300})
    )
    before = _groups()
    argv = ["unshare", "--pid", "--mount", "--cgroup", "--ipc", "--uts", "--fork", "--kill-child", "sh", "-c"]
    boot = BOOT.format(systemd=SYSTEMD)
    process = subprocess.Popen(
        [*argv, boot, "boot", str(folder)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    try:
        pid = until(lambda: _child(process.pid), "PID 1 of the namespace")
        assert pid is not None
        made = Manager(pid, data, port)
        try:
            until(lambda: made.ctl("is-active", "test.target").stdout.strip() == "active", "systemd to be up")
        except AssertionError:
            pytest.skip("no systemd can be PID 1 of a namespace here")
        yield made
    finally:
        process.kill()  # and with it everything in its namespace
        process.communicate()
        until(lambda: _removed(before), "the groups of that systemd to be empty")
        shutil.rmtree((data / "run").resolve(), ignore_errors=True)


def _groups() -> set[Path]:
    """Every control group with a unit's name: a systemd leaves those that it has made, empty."""
    found = (Path(folder) for folder, _, _ in os.walk("/sys/fs/cgroup"))
    return {folder for folder in found if folder.suffix in UNITS}


def _removed(before: set[Path]) -> bool:
    """Remove what is empty of the groups that have come since; whether all are gone."""
    for folder in sorted(_groups() - before, key=lambda path: -len(path.parts)):
        with contextlib.suppress(OSError):  # somebody is in it still
            folder.rmdir()
    return _groups() <= before


def _child(pid: int) -> int | None:
    found = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return int(found[0]) if found else None


def test_the_guard_dies_under_systemd_and_the_same_core_serves_on(manager: Manager) -> None:
    started = manager.ctl("start", "hardcore.service")
    assert started.returncode == 0, started.stderr + manager.ctl("status", "hardcore.service").stdout
    before = manager.running()
    assert int(manager.shown("MainPID")) == before["launcher"]["pid"]

    manager.kill(before["sentinel"]["pid"])
    until(
        lambda: manager.status().get("sentinel", {}).get("pid") not in {None, before["sentinel"]["pid"]},
        "a guard",
    )
    after = manager.running()
    assert after["core"]["pid"] == before["core"]["pid"]
    assert manager.shown("NRestarts") == "0"  # systemd had nothing to do

    manager.kill(before["launcher"]["pid"])
    until(
        lambda: manager.shown("NRestarts") == "1" and manager.shown("ActiveState") == "active", "a launcher"
    )
    again = manager.running()
    assert again["core"]["pid"] == before["core"]["pid"]
    assert again["launcher"]["pid"] == int(manager.shown("MainPID")) != before["launcher"]["pid"]
    with urllib.request.urlopen(f"http://127.0.0.1:{manager.port}/readyz", timeout=10) as answer:
        assert answer.status == 200

    assert manager.ctl("stop", "hardcore.service").returncode == 0
    until(lambda: manager.shown("ActiveState") == "inactive", "everything to be stopped")
    assert manager.wanted() == "UP"  # a stop for a reboot changes nobody's will


def test_what_was_told_to_stay_off_is_not_started_by_whoever_asks(manager: Manager) -> None:
    manager.ctl("start", "hardcore.service")
    manager.running()
    assert manager.hardcore("down").returncode == 0
    until(lambda: manager.shown("ActiveState") == "inactive", "the service to have ended")
    until(
        lambda: not _asks(manager.port) and manager.state("socket") == "inactive",
        "the address to be given up",
    )
    assert manager.state("service") == "inactive"  # nothing has failed, and nothing is tried any more
    assert manager.wanted() == "DOWN"
    assert not manager.status()  # no guard, and so no core

    standing.want_up(locate(manager.data))
    assert manager.ctl("start", "hardcore.socket", "hardcore.service").returncode == 0
    manager.running()
    assert manager.state("service") == manager.state("socket") == "active"


def _asks(port: int) -> bool:
    """Ask as an open browser tab does; return whether anybody is at the address."""
    try:
        with socket.create_connection(("127.0.0.1", port), 2) as asking:
            asking.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
    except OSError:
        return False
    return True
