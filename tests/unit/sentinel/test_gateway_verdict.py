"""A gateway is ended only on two kinds of evidence that have lasted; whatever else explains a silence leaves it alone."""

from dataclasses import dataclass, field

import pytest
from msgspec.structs import replace

from hardcore.model.clocks import Clocks
from hardcore.model.gateway import GatewayPulse
from hardcore.model.looks import ProcessSample, ThreadSample
from hardcore.model.verdicts import Colour, Diagnosis, Verdict
from hardcore.sentinel.gateway_verdict import GatewayBench
from hardcore.sentinel.patience import Patience

MS = 1_000_000
S = 1_000 * MS
TICK = 100 * MS
PATIENCE = Patience(100, 300, 400, 1_500)
BEGAN = 1_000 * S
PULSE = GatewayPulse(pid=7, start=1, loop_thread=7, beat_thread=8)
#: Longer than any patience of it.
LONG = 300


@dataclass
class Scene:
    """A gateway at its looks; what a test does to it lasts until it is changed."""

    bench: GatewayBench = field(default_factory=lambda: GatewayBench(PATIENCE, BEGAN + 20 * S))
    now: int = BEGAN
    pulse: GatewayPulse | None = PULSE
    state: str = "S"
    loop_state: str = "S"
    loop_waits: str = "do_epoll_wait"
    cpu_ns: int = 0
    loop_cpu_ns: int = 0
    delay_ns: int = 0
    beats_loop: bool = True
    beats_thread: bool = True
    #: Processor time of the loop's thread, and time it was ready and not let, in each tick.
    burns_ns: int = 0
    queues_ns: int = 0
    asleep_ns: int = 0  # of a suspended machine

    def look(self, ticks: int = 1, gap_ns: int = TICK) -> Verdict:
        verdict = None
        for _ in range(ticks):
            self.now += gap_ns
            self.cpu_ns += self.burns_ns
            self.loop_cpu_ns += self.burns_ns
            self.delay_ns += self.queues_ns
            if self.pulse is not None:
                told = {"loop_ns": self.now} if self.beats_loop else {}
                told |= {"thread_ns": self.now} if self.beats_thread else {}
                self.pulse = replace(self.pulse, **told)
            loop = ThreadSample(self.loop_state, self.loop_cpu_ns, self.loop_waits, self.delay_ns)
            beat = ThreadSample("S", 0, "futex_wait_queue")
            sample = ProcessSample(self.state, self.cpu_ns, 1 << 25, 4, loop=loop, beat=beat, busy=0)
            clocks = Clocks(self.now + self.asleep_ns, self.now + self.asleep_ns)
            verdict = self.bench.judge(self.now, self.pulse, sample, clocks)
            if verdict.colour is Colour.RED:
                return verdict
        assert verdict is not None, "at least one look"
        return verdict


def settled() -> Scene:
    scene = Scene()
    assert scene.look(30).colour is Colour.GREEN
    return scene


def test_a_gateway_that_works_and_one_that_rests_are_left_alone() -> None:
    scene = settled()
    assert scene.look(LONG).colour is Colour.GREEN
    scene.burns_ns, scene.loop_state, scene.loop_waits = 99 * MS, "R", ""
    assert scene.look(LONG).colour is not Colour.RED


def test_one_that_is_stopped_is_found_after_its_patience_and_not_before() -> None:
    scene = settled()
    scene.state = scene.loop_state = "T"
    scene.beats_loop = scene.beats_thread = False
    assert scene.look(14).colour is not Colour.RED
    assert scene.look(10).diagnosis is Diagnosis.FROZEN


def test_a_short_stop_heals() -> None:
    scene = settled()
    for _ in range(10):
        scene.state, scene.beats_loop, scene.beats_thread = "T", False, False
        assert scene.look(10).colour is not Colour.RED
        scene.state, scene.beats_loop, scene.beats_thread = "S", True, True
        assert scene.look(5).colour is not Colour.RED


def test_silence_alone_is_no_verdict_while_the_kernel_says_that_it_works() -> None:
    scene = settled()
    scene.beats_loop = scene.beats_thread = False
    scene.state = scene.loop_state = "R"
    scene.loop_waits, scene.queues_ns = "", TICK  # ready all the time, and never let
    assert scene.look(LONG).colour is not Colour.RED


def test_a_loop_that_is_asleep_beside_a_thread_that_beats_is_blocked() -> None:
    scene = settled()
    scene.beats_loop, scene.loop_waits = False, "futex_wait_queue"
    assert scene.look(10).colour is not Colour.RED
    assert scene.look(20).diagnosis is Diagnosis.LOOP_BLOCKED


def test_whoever_holds_the_interpreter_asleep_is_found() -> None:
    scene = settled()
    scene.beats_loop = scene.beats_thread = False
    scene.loop_waits = "hrtimer_nanosleep"
    assert scene.look(10).colour is not Colour.RED
    assert scene.look(30).diagnosis in {Diagnosis.GIL_HELD, Diagnosis.LOOP_BLOCKED}


def test_a_loop_without_an_end_has_to_burn_its_patience() -> None:
    scene = settled()
    scene.beats_loop, scene.burns_ns, scene.state, scene.loop_state, scene.loop_waits = (
        False,
        TICK,
        "R",
        "R",
        "",
    )
    assert scene.look(12).colour is not Colour.RED
    assert scene.look(40).diagnosis is Diagnosis.SPINNING


def test_a_long_collection_of_garbage_has_a_patience_of_its_own() -> None:
    scene = settled()
    assert scene.pulse is not None
    scene.pulse = replace(scene.pulse, gc_since_ns=scene.now)
    scene.beats_loop = scene.beats_thread = False
    scene.burns_ns, scene.state, scene.loop_state, scene.loop_waits = TICK, "R", "R", ""
    assert scene.look(40).colour is not Colour.RED


@pytest.mark.parametrize("gap_ns", [1 * S, 30 * S])
def test_a_guard_that_comes_late_itself_holds_that_against_nobody(gap_ns: int) -> None:
    scene = settled()
    for _ in range(20):
        scene.beats_loop = scene.beats_thread = False
        assert scene.look(gap_ns=gap_ns).colour is not Colour.RED
        scene.beats_loop = scene.beats_thread = True
        assert scene.look().colour is not Colour.RED


def test_a_machine_that_slept_begins_anew() -> None:
    scene = settled()
    scene.beats_loop = scene.beats_thread = False
    scene.look(10)
    scene.asleep_ns += 3_600 * S
    assert scene.look(1).colour is not Colour.RED
    scene.beats_loop = scene.beats_thread = True
    assert scene.look(20).colour is not Colour.RED


def test_one_that_has_not_begun_to_beat_is_given_its_start_and_then_only_the_kernel_speaks() -> None:
    scene = Scene(pulse=None)
    assert scene.look(400).colour is not Colour.RED  # idle, with no page: nothing is inferred
    scene.state = scene.loop_state = "T"
    assert scene.look(30).diagnosis is Diagnosis.FROZEN


def test_one_whose_process_can_not_be_seen_is_never_ended() -> None:
    scene = settled()
    for _ in range(LONG):
        scene.now += TICK
        clocks = Clocks(scene.now, scene.now)
        assert scene.bench.judge(scene.now, scene.pulse, None, clocks).colour is Colour.GREEN
