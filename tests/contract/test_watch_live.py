"""The watch over a real process: its real page, what the real kernel says of it, and the judge."""

import contextlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from core.guarded.recorder import Recorder, Stage
from hardcore.host import clock, lives, processes
from hardcore.host.folders import Folders
from hardcore.host.lives import Life
from hardcore.model.observations import Sampled
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


@pytest.fixture
def own(tmp_path: Path) -> Iterator[tuple[Recorder, Life]]:
    """This process as the core: its page, and the guard's view of it."""
    folders = Folders(tmp_path, tmp_path)
    life = lives.conceive(folders, 1)
    life.handle = processes.find(processes.Identity(os.getpid(), processes.start_of(os.getpid()) or 0))
    recorder = Recorder.open(folders.recorder(life.nonce))
    assert isinstance(recorder, Recorder), recorder
    yield recorder, life
    recorder.close()
    life.let_go()


def beat(recorder: Recorder) -> None:
    recorder.beat_loop(time.monotonic_ns())
    recorder.beat_thread(time.monotonic_ns())


def test_a_look_has_the_last_commit_and_both_other_clocks(own: tuple[Recorder, Life]) -> None:
    recorder, life = own
    beat(recorder)
    recorder.witness(7, 3, bytes(32))
    looked = life.look()
    assert looked.witness is not None
    assert (looked.witness.seq, looked.witness.epoch) == (7, 3)
    assert looked.clocks is not None
    assert abs(looked.clocks.wall_ns - time.time_ns()) < 60_000_000_000
    assert looked.clocks.boot_ns >= looked.at_ns - 1_000_000_000, "it counts what the other one sleeps over"


def test_one_command_that_is_decided_for_long_is_seen_with_its_thread_though_others_come_and_go(
    own: tuple[Recorder, Life],
) -> None:
    recorder, life = own
    slow = recorder.begin("slow", None, "book", "t1", ["a1"], b"", 0)
    assert slow is not None
    recorder.stage(slow, Stage.DECIDING)

    def looked() -> Sampled:
        beat(recorder)
        quick = recorder.begin("quick", None, "book", "t2", ["a2"], b"", 0)
        assert quick is not None
        recorder.finish(quick, 201)
        return life.look()

    def with_thread() -> bool:
        process = looked().process
        return process is not None and process.deciding[:1] != ()

    until(with_thread, "the thread to be looked at")

    def slow_by_now() -> bool:
        looked()
        return life._one_is_slow

    until(slow_by_now, "it to be slow")
    for _ in range(2 * lives.IN_FLIGHT_EVERY_TICKS):
        tick = looked()
        assert tick.in_flight is not None, "from now on it is watched at every tick"
        assert [note.command_id for note in tick.in_flight] == ["slow"]
        assert tick.process is not None
        assert [tid for tid, _ in tick.process.deciding] == [threading.get_native_id()]
    recorder.finish(slow, 201)
    looked()
    assert not life._one_is_slow


def test_a_core_without_work_is_looked_at_by_its_beats_alone(own: tuple[Recorder, Life]) -> None:
    recorder, life = own
    for _ in range(2 * lives.IN_FLIGHT_EVERY_TICKS):
        beat(recorder)
        tick = life.look()
        assert tick.in_flight is None
        assert tick.process is not None
        assert (tick.process.loop, tick.process.deciding) == (None, ())
