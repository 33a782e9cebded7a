"""A drill is the real fault: what it does to a process is seen from outside."""

import os
import signal
from collections.abc import Callable

import pytest

from tests.unit.core_guarded.conftest import Guest, until

Start = Callable[[str], Guest]


def order(fault: str, generation: int = 4) -> dict[str, object]:
    return {"verb": "drill", "fault": fault, "generation": generation}


@pytest.mark.parametrize("mode", ["serve", "serve-uvloop"])
@pytest.mark.parametrize(("fault", "status"), [("crash", -signal.SIGABRT), ("exit", 3)])
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


def test_an_order_of_an_older_generation_breaks_nothing(guest: Start) -> None:
    core = guest("serve")
    assert core.line() == "up"
    assert core.ask(order("freeze", generation=5)) == [{"ok": True}]
    os.waitid(os.P_PID, core.process.pid, os.WSTOPPED | os.WNOWAIT)
    core.process.send_signal(signal.SIGCONT)
    answers = core.ask(order("exit", generation=4), {"verb": "status"})
    assert [answer["ok"] for answer in answers] == [False, True]
    assert core.process.poll() is None
