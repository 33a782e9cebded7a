"""Records the traces: `python -m tests.unit.sentinel.record [FAULT ...]` (all without a name; some 2 minutes).

Each is a real guest under the real watch, one look in 100 ms, and a look at its stacks whenever the judge asks for
one. They are taken once and kept, because a unit test shall not depend on how busy its machine is; take them anew when
what is looked at changes.
"""

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

from hardcore.host import clock, lives, processes
from hardcore.host.folders import Folders
from hardcore.host.lives import Life
from hardcore.model.observations import StacksSampled
from hardcore.model.verdicts import Wish
from hardcore.sentinel.verdict import Bench
from hardcore.snapshot import stacks
from tests.unit.sentinel import recordings
from tests.unit.sentinel.recordings import Fact
from tests.unit.sentinel.traces import PATIENCE
from tests.waiting import until

ROOT = Path(__file__).parents[3]
EVERY_NS = 100_000_000
NEIGHBOURS = 16
TICKS = {
    "quiet": 10,
    "block": 20,
    "spin": 50,
    "gil_asleep": 20,
    "gil_locked": 20,
    "gil_computing": 35,
    "dump": 20,
    "collection": 50,
    "slow_transaction": 30,
    "deadlock": 25,
    "stop_long": 20,
    "stop_short": 40,
    "neighbours": 60,
    "neighbours_dump": 80,
    "neighbours_collection": 100,
}


class Recording:
    """One guest, watched tick by tick."""

    def __init__(self, life: Life) -> None:
        self.life = life
        self.facts: list[Fact] = []
        self.bench = Bench(PATIENCE)
        self._looking: threading.Thread | None = None
        self._found: list[StacksSampled] = []
        self._pause = threading.Event()

    def tick(self, due_ns: int) -> None:
        self._pause.wait(max(0.0, (due_ns - clock.now_ns()) / 1e9))
        while self._found:
            fact = self._found.pop(0)
            self.bench.hear(fact)
            self.facts.append(fact)
        tick = self.life.look()
        self.facts.append(tick)
        said = self.bench.judge(tick)
        if Wish.STACKS in said.wishes and (self._looking is None or not self._looking.is_alive()):
            self._looking = threading.Thread(target=self._look)
            self._looking.start()

    def _look(self) -> None:
        assert self.life.handle is not None
        found = stacks.sample(self.life.handle.pid, stacks.find_tools(), clock.now_ns() + 1_000_000_000)
        if not isinstance(found, str):
            self._found.append(StacksSampled(clock.now_ns(), 1, found[0]))

    def finish(self) -> None:
        if self._looking is not None:
            self._looking.join()


def record(fault: str) -> list[Fact]:
    with contextlib.ExitStack() as ending:
        folder = Path(ending.enter_context(tempfile.TemporaryDirectory()))
        life = lives.conceive(Folders(folder, folder), 1)
        page = Folders(folder, folder).recorder(life.nonce)
        guest = _begin(ending, [sys.executable, "-m", "tests.unit.sentinel.guest", str(page), fault])
        start = until(lambda: processes.start_of(guest.pid), "the guest to be there")
        assert start is not None
        life.handle = processes.find(processes.Identity(guest.pid, start))
        ending.callback(life.let_go)
        until(lambda: (b := life.look().beats) is not None and b.thread_count > 4, "its beats", 60)
        if fault.startswith("neighbours"):
            for _ in range(NEIGHBOURS):
                _begin(ending, [sys.executable, "-c", "while True: pass"])
        recording = Recording(life)
        ending.callback(recording.finish)
        began_ns = clock.now_ns()
        for tick in range(TICKS[fault]):
            recording.tick(began_ns + tick * EVERY_NS)
            _stop_and_go(fault, tick, guest.pid)
        return recording.facts


def _stop_and_go(fault: str, tick: int, pid: int) -> None:
    if fault == "stop_long" and tick == 6:
        os.kill(pid, signal.SIGSTOP)
    if fault == "stop_short" and tick % 5 in {1, 3}:
        os.kill(pid, signal.SIGSTOP if tick % 5 == 1 else signal.SIGCONT)


def _begin(ending: contextlib.ExitStack, argv: list[str]) -> "subprocess.Popen[bytes]":
    process = ending.enter_context(subprocess.Popen(argv, cwd=ROOT, stdin=subprocess.PIPE))
    ending.callback(process.kill)
    return process


if __name__ == "__main__":
    for name in sys.argv[1:] or TICKS:
        facts = record(name)
        recordings.FOLDER.mkdir(exist_ok=True)
        recordings.write(recordings.FOLDER / f"{name}.jsonl", facts)
        print(name, len(facts))  # noqa: T201  a tool that says how far it has come
