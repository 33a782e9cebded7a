"""One guarded life as its guard sees it: beats, TERM, last words, stacks, and every kind of leaving."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable

import pytest

from core.guarded.tracing import allow_tracing
from hardcore.sentinel.heartbeat import Notice
from tests.unit.core_guarded.conftest import ROOT, WAIT_S_MAX, Guest, until

Start = Callable[[str], Guest]


def beats_of_both(guest: Guest, more_than: tuple[int, int] = (0, 0)) -> bool:
    beats = guest.reader.beats()
    return beats is not None and beats.loop_count > more_than[0] and beats.thread_count > more_than[1]


@pytest.mark.parametrize("mode", ["serve", "serve-uvloop"])
def test_a_living_core_beats_from_its_loop_and_from_a_thread(guest: Start, mode: str) -> None:
    core = guest(mode)
    assert core.line() == "up"
    until(lambda: beats_of_both(core), "the first beats")
    first = core.page()
    until(lambda: beats_of_both(core, (first.beats.loop_count, first.beats.thread_count)), "more beats")
    assert first.pid == core.process.pid
    assert first.threads.loop == core.process.pid
    assert first.threads.beat not in {0, core.process.pid}
    assert core.notice() == Notice(watchdog=True)
    assert core.notice() == Notice(watchdog=True)


@pytest.mark.parametrize("mode", ["serve", "serve-uvloop", "early-thread"])
def test_a_term_is_told_with_its_sender_and_obeyed_once(guest: Start, mode: str) -> None:
    core = guest(mode)
    assert core.line() == "up"
    core.process.terminate()
    # A thread that was there before TERM was held back may take the signal, and then nobody knows whose.
    senders = {os.getpid(), 0} if mode == "early-thread" else {os.getpid()}
    assert core.line() in {f"term {sender}" for sender in senders}
    assert core.process.wait() == 0
    notices = [core.notice()]
    while notices[-1] != Notice(stopping=True):
        notices.append(core.notice())
    assert {n.term_pid for n in notices if isinstance(n, Notice)} - {None} <= senders
    assert [event.code for event in core.page().events] == ["TERM"]
    assert not core.control.exists()


def test_a_blocked_loop_still_tells_who_sent_the_term(guest: Start) -> None:
    core = guest("serve")
    assert core.line() == "up"
    assert core.ask({"verb": "drill", "fault": "block", "generation": 1}) == [{"ok": True}]
    core.process.terminate()
    until(lambda: "TERM" in {event.code for event in core.page().events}, "the TERM in the recorder")
    assert core.process.poll() is None


def test_a_forked_child_can_be_terminated(guest: Start) -> None:
    core = guest("fork")
    assert core.line() == "blocked False"
    assert core.process.wait() == 0


def test_the_exception_that_ends_the_process_is_its_last_word(guest: Start) -> None:
    core = guest("fail-in-main")
    assert core.process.wait() == 1
    words = core.page().last_words
    assert words is not None
    assert words.code == "EXCEPTION"
    assert words.text.startswith("ValueError at core_guarded/guest.py:")
    assert "fail_in_main: no more core" in words.text


@pytest.mark.parametrize(
    ("mode", "code"), [("fail-in-thread", "THREAD_EXCEPTION"), ("fail-in-loop", "LOOP_EXCEPTION")]
)
def test_an_exception_that_ends_only_a_part_is_an_event_of_a_living_core(
    guest: Start, mode: str, code: str
) -> None:
    core = guest(mode)
    assert core.line() == "up"
    until(lambda: bool(core.page().events), "the event")
    (event,) = core.page().events
    assert event.code == code
    assert event.text.startswith("LookupError at core_guarded/guest.py:")
    assert core.page().last_words is None
    core.process.terminate()
    assert core.process.wait() == 0


def test_a_fatal_signal_leaves_the_stacks_of_all_threads(guest: Start) -> None:
    core = guest("segv")
    assert core.process.wait() == -signal.SIGSEGV
    stacks = core.stacks.read_text()
    assert "Segmentation fault" in stacks
    assert "guest.py" in stacks
    assert core.stacks.stat().st_mode & 0o777 == 0o600


def test_the_stacks_can_be_had_while_c_code_holds_the_interpreter(guest: Start) -> None:
    core = guest("hold-the-interpreter")
    assert core.line() == "up"
    until(core.stacks.exists, "the file for the stacks")

    def asked() -> bool:
        core.process.send_signal(signal.SIGUSR1)
        return "in serve" in core.stacks.read_text()

    until(asked, "the frame that holds the interpreter")
    assert core.process.poll() is None


def test_a_core_takes_no_page_of_another_life_and_says_so(guest: Start) -> None:
    first = guest("serve")
    assert first.line() == "up"
    second = subprocess.run(
        [sys.executable, "-m", "tests.unit.core_guarded.guest", "serve"],
        cwd=ROOT,
        env={**os.environ, "HARDCORE_RECORDER": str(first.stacks.with_suffix(""))},
        capture_output=True,
        text=True,
        timeout=WAIT_S_MAX,
        check=False,
    )
    assert second.returncode == 1
    assert f"already belongs to process {first.process.pid}" in second.stderr
    assert first.process.poll() is None


def test_allowing_to_be_traced_needs_no_particular_kernel() -> None:
    assert allow_tracing() in {True, False}
