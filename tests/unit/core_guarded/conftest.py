"""Starts guests and ends them."""

import contextlib
import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import monotonic

import pytest

from hardcore.host.recorder import PageReader, make_page
from hardcore.model.recorder import Page
from hardcore.sentinel.heartbeat import NOTICE_BYTES_MAX, MalformedNotice, Notice, read_notice

ROOT = Path(__file__).parents[3]
WAIT_S_MAX = 30.0


def until(condition: Callable[[], bool], what: str) -> None:
    """Wait for a condition, not for a time."""
    deadline = monotonic() + WAIT_S_MAX
    while not condition():
        assert monotonic() < deadline, f"never came: {what}"
        os.sched_yield()


@dataclass(frozen=True, slots=True)
class Guest:
    """A guest with the guard's ends of its wires."""

    process: "subprocess.Popen[str]"
    reader: PageReader
    ear: socket.socket
    control: Path
    stacks: Path

    def line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def page(self) -> Page:
        page = self.reader.read()
        assert isinstance(page, Page), page
        return page

    def notice(self) -> Notice | MalformedNotice:
        self.ear.settimeout(WAIT_S_MAX)
        return read_notice(self.ear.recv(NOTICE_BYTES_MAX + 1))

    def ask(self, *orders: object) -> list[dict[str, object]]:
        """Give orders on one connection; return the answers until the guest hangs up or all are there."""
        with socket.socket(socket.AF_UNIX) as line:
            line.settimeout(WAIT_S_MAX)
            line.connect(str(self.control))
            line.sendall(b"".join(json.dumps(order).encode() + b"\n" for order in orders))
            with line.makefile("rb") as incoming:
                lines = [incoming.readline() for _ in orders]
        return [json.loads(line) for line in lines if line]


@pytest.fixture
def guest(tmp_path: Path) -> Iterator[Callable[[str], Guest]]:
    """Start guests; none of them outlives the test."""
    with contextlib.ExitStack() as stack:

        def started(mode: str) -> Guest:
            page = tmp_path / "page"
            make_page(page, "nonce-1", "boot")
            ear = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
            ear.bind(str(tmp_path / "notify"))
            reader = PageReader(page, "nonce-1")
            stack.callback(reader.close)
            wires = {
                "HARDCORE_RECORDER": str(page),
                "HARDCORE_CONTROL": str(tmp_path / "control"),
                "NOTIFY_SOCKET": str(tmp_path / "notify"),
                "WATCHDOG_USEC": "300000",
            }
            log = stack.enter_context((tmp_path / "log").open("wb"))
            process = stack.enter_context(
                subprocess.Popen(
                    [sys.executable, "-X", "dev", "-m", "tests.unit.core_guarded.guest", mode],
                    cwd=ROOT,
                    env={**os.environ, **wires},
                    stdout=subprocess.PIPE,
                    stderr=log,
                    text=True,
                )
            )
            # Killed first, then awaited by the Popen's own exit: also when it is stopped or blocked.
            stack.callback(process.kill)
            return Guest(process, reader, ear, tmp_path / "control", tmp_path / "page.stacks")

        yield started
