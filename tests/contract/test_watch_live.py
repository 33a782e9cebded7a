"""The watch over a real process: its real page, what the real kernel says of it, and the judge."""

import contextlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from hardcore.host import clock, lives, processes
from hardcore.host.folders import Folders
from hardcore.host.lives import Life
from hardcore.model.verdicts import GREEN, Colour, Diagnosis, Verdict
from hardcore.recovery import plan
from hardcore.recovery.policy import Policy
from hardcore.sentinel.verdict import Bench
from tests.waiting import until

ROOT = Path(__file__).parents[2]
GIVE_UP_S = 60.0

Guest = subprocess.Popen[bytes]


class Watch:
    """Looks at a life as often as the policy says, however often it is asked."""

    def __init__(self, life: Life, policy: Policy) -> None:
        self.life = life
        self._bench = Bench(plan.patience(policy))
        self._every_ns = policy.health_check_interval_ms * 1_000_000
        self._next_ns = 0
        self.said = GREEN

    def look(self) -> Verdict:
        if clock.now_ns() >= self._next_ns:
            self._next_ns = clock.now_ns() + self._every_ns
            self.said = self._bench.judge(self.life.look())
        return self.said


@pytest.fixture
def guest(tmp_path: Path) -> Iterator[tuple[Guest, Watch]]:
    life = lives.conceive(Folders(tmp_path, tmp_path), 1)
    page = Folders(tmp_path, tmp_path).recorder(life.nonce)
    argv = [sys.executable, "-m", "tests.contract.loop_that_ends", str(page)]
    with contextlib.ExitStack() as ending:
        process = ending.enter_context(
            subprocess.Popen(argv, cwd=ROOT, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
        )
        ending.callback(process.kill)
        start = until(lambda: processes.start_of(process.pid), "the guest to be there")
        assert start is not None, "as above"
        life.handle = processes.find(processes.Identity(process.pid, start))
        ending.callback(life.let_go)
        yield process, Watch(life, Policy())


def test_a_core_whose_loop_is_over_is_lost_though_other_threads_keep_it_alive(
    guest: tuple[Guest, Watch],
) -> None:
    process, watch = guest
    until(lambda: (b := watch.life.look().beats) is not None and b.thread_count > 20, "beats", GIVE_UP_S)
    assert process.stdin is not None
    process.stdin.write(b"\n")
    process.stdin.flush()
    until(lambda: watch.look().colour is Colour.RED, "a verdict", GIVE_UP_S)
    assert process.poll() is None
    assert watch.said.diagnosis is Diagnosis.LOOP_BLOCKED
    whys = [testimony.why for testimony in watch.said.testimonies]
    assert any("asleep on a lock" in why for why in whys), whys
    assert any("no thread" in why for why in whys), whys


def test_a_core_that_waits_for_work_is_never_lost(guest: tuple[Guest, Watch]) -> None:
    process, watch = guest
    seen: set[Colour] = set()

    def beaten() -> bool:
        seen.add(watch.look().colour)
        beats = watch.life.look().beats
        return beats is not None and beats.loop_count > 100

    until(beaten, "a hundred beats", GIVE_UP_S)
    assert Colour.RED not in seen
    assert process.poll() is None
