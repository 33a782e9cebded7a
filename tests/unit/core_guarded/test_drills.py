"""A drill is the real fault: what it does to a process is seen from outside."""

import os
import resource
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.unit.core_guarded.conftest import Guest, until

Start = Callable[[str], Guest]


def order(fault: str, generation: int = 4) -> dict[str, object]:
    return {"verb": "drill", "fault": fault, "generation": generation}


@pytest.mark.parametrize("mode", ["serve", "serve-uvloop"])
@pytest.mark.parametrize(
    ("fault", "status"), [("crash", -signal.SIGABRT), ("segv", -signal.SIGSEGV), ("exit", 3)]
)
def test_a_core_answers_first_and_then_dies_as_ordered(
    guest: Start, mode: str, fault: str, status: int
) -> None:
    core = guest(mode)
    assert core.line() == "up"
    assert core.ask(order(fault)) == [{"ok": True}]
    assert core.process.wait() == status
    page = core.page()
    assert [(event.code, event.text) for event in page.events] == [("DRILL", fault)]
    # It is to look like the accident: nothing that a real one would not leave.
    assert page.last_words is None


def test_freeze_stops_the_whole_process(guest: Start) -> None:
    core = guest("serve")
    assert core.line() == "up"
    assert core.ask(order("freeze")) == [{"ok": True}]
    stopped = os.waitid(os.P_PID, core.process.pid, os.WSTOPPED | os.WNOWAIT)
    assert stopped is not None
    assert stopped.si_status == signal.SIGSTOP
    core.process.send_signal(signal.SIGCONT)
    assert core.ask({"verb": "status"})[0]["epoch"] == 7


def test_block_stops_the_loop_alone(guest: Start) -> None:
    core = guest("serve")
    assert core.line() == "up"
    assert core.ask(order("block")) == [{"ok": True}]

    def only_the_thread_beats() -> bool:
        first = core.page().beats
        until(lambda: core.page().beats.thread_count > first.thread_count + 8, "beats of the thread")
        return core.page().beats.loop_count == first.loop_count

    until(only_the_thread_beats, "a loop that no longer beats")


def test_segv_leaves_the_stacks_that_a_real_one_would(guest: Start) -> None:
    core = guest("serve")
    assert core.line() == "up"
    core.ask(order("segv"))
    core.process.wait()
    stacks = core.stacks.read_text()
    assert "Segmentation fault" in stacks
    assert "string_at" in stacks


def ticks_of_cpu(core: Guest, thread: int) -> int:
    """User and system time of a thread, in the kernel's ticks."""
    fields = Path(f"/proc/{core.process.pid}/task/{thread}/stat").read_text().rpartition(")")[2].split()
    return int(fields[11]) + int(fields[12])


def test_spin_burns_on_the_loop_while_other_threads_go_on(guest: Start) -> None:
    core = guest("serve")
    assert core.line() == "up"
    assert core.ask(order("spin")) == [{"ok": True}]
    before = ticks_of_cpu(core, core.process.pid)
    until(lambda: ticks_of_cpu(core, core.process.pid) > before + 5, "the loop's thread to compute")
    first = core.page().beats
    until(lambda: core.page().beats.thread_count > first.thread_count + 8, "beats of the thread")
    assert core.page().beats.loop_count == first.loop_count


def test_gil_stops_everything_without_computing_and_no_signal_heals_it(guest: Start) -> None:
    core = guest("serve")
    assert core.line() == "up"
    assert core.ask(order("gil")) == [{"ok": True}]

    def nothing_beats() -> bool:
        first = core.page().beats
        cpu = ticks_of_cpu(core, core.process.pid)
        core.process.send_signal(signal.SIGUSR1)  # a guard asks for the stacks: it is not to end the fault
        until(lambda: core.stacks.read_text().count("_hold_interpreter") > 1, "the stacks, twice")
        beats = core.page().beats
        return (beats.loop_count, beats.thread_count) == (
            first.loop_count,
            first.thread_count,
        ) and ticks_of_cpu(core, core.process.pid) - cpu < 5

    until(core.stacks.exists, "the file for the stacks")
    until(lambda: asked_for_stacks(core), "the frame that holds the interpreter")
    until(nothing_beats, "a core in which nothing beats and nothing computes")
    assert core.process.poll() is None


def asked_for_stacks(core: Guest) -> bool:
    core.process.send_signal(signal.SIGUSR1)
    return "_hold_interpreter" in core.stacks.read_text()


def test_a_long_collection_is_announced_and_survived(guest: Start) -> None:
    core = guest("serve")
    assert core.line() == "up"
    assert core.ask(order("gc")) == [{"ok": True}]
    until(lambda: core.page().beats.gc_since_ns > 0, "a collection to be announced")
    since = core.page().beats
    until(lambda: core.page().beats.loop_count > since.loop_count + 4, "beats of the loop afterwards")
    assert core.ask({"verb": "status"})[0]["epoch"] == 7
    assert core.page().last_words is None


def test_memory_is_used_up_on_a_thread_of_its_own_and_only_if_armed(guest: Start) -> None:
    core = guest("serve")
    assert core.line() == "up"
    (refused,) = core.ask(order("oom"))
    assert refused["ok"] is False
    # Bounded in another way than a guard does it, because a test may not have a memory cgroup to give.
    room = 1 << 30
    resource.prlimit(core.process.pid, resource.RLIMIT_AS, (room, room))
    assert core.ask({**order("oom"), "armed": True}) == [{"ok": True}]
    until(lambda: any("MemoryError" in event.text for event in core.page().events), "no memory to be left")
    beats = core.page().beats
    until(lambda: core.page().beats.loop_count > beats.loop_count + 4, "the loop to go on meanwhile")


def test_an_order_of_an_older_generation_breaks_nothing(guest: Start) -> None:
    core = guest("serve")
    assert core.line() == "up"
    assert core.ask(order("freeze", generation=5)) == [{"ok": True}]
    os.waitid(os.P_PID, core.process.pid, os.WSTOPPED | os.WNOWAIT)
    core.process.send_signal(signal.SIGCONT)
    answers = core.ask(order("exit", generation=4), {"verb": "status"})
    assert [answer["ok"] for answer in answers] == [False, True]
    assert core.process.poll() is None
