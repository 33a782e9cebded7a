"""What the kernel says of a process and its threads: every number is of the process that was meant."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import psutil

from hardcore.host import processes, vitals
from tests.waiting import until

MY_START = processes.start_of(os.getpid()) or 0


@contextmanager
def asleep() -> Iterator[int]:
    """A thread of ours that waits on a lock; yields its id."""
    told: list[int] = []
    wake = threading.Event()

    def wait() -> None:
        told.append(threading.get_native_id())
        wake.wait()

    thread = threading.Thread(target=wait)
    thread.start()
    try:
        until(lambda: told and vitals.thread_sample(os.getpid(), told[0]).state == "S", "it to sleep")
        yield told[0]
    finally:
        wake.set()
        thread.join()


def test_a_process_is_seen_as_others_see_it() -> None:
    seen = vitals.process_sample(os.getpid(), MY_START, vitals.Wanted(fds=True))
    assert seen is not None
    other = psutil.Process()
    assert seen.threads == other.num_threads()
    assert abs(seen.rss_bytes - other.memory_info().rss) < 8 << 20
    assert seen.fds is not None
    assert abs(seen.fds - other.num_fds()) <= 1, "a listing has a descriptor of its own"
    times = other.cpu_times()
    assert abs(seen.cpu_ns / 1e9 - times.user - times.system) < 1


def test_another_process_under_the_same_number_is_not_the_one_that_was_meant() -> None:
    assert vitals.process_sample(os.getpid(), MY_START - 1, vitals.Wanted()) is None


def test_only_the_threads_that_are_wanted_are_looked_at_each_under_its_part() -> None:
    with asleep() as tid:
        wanted = vitals.Wanted(loop=os.getpid(), writer=tid, deciding=(tid, 0))
        seen = vitals.process_sample(os.getpid(), MY_START, wanted)
        assert seen is not None
        assert seen.beat is None
        assert seen.loop is not None
        assert seen.loop.state == "R"
        assert seen.writer is not None
        assert seen.deciding == ((tid, seen.writer),)


def test_of_many_commands_in_flight_a_bounded_number_of_threads_is_looked_at() -> None:
    seen = vitals.process_sample(os.getpid(), MY_START, vitals.Wanted(deciding=tuple(range(1, 100))))
    assert seen is not None
    assert len(seen.deciding) == vitals.DECIDING_MAX


def test_a_sleeping_thread_says_what_it_sleeps_in_and_takes_no_turns() -> None:
    with asleep() as tid:
        first = vitals.thread_sample(os.getpid(), tid)
        assert "futex" in first.waits_in
        assert vitals.thread_sample(os.getpid(), tid) == first


def test_a_working_thread_takes_turns_and_time() -> None:
    first = vitals.thread_sample(os.getpid(), os.getpid())

    def again() -> bool:
        now = vitals.thread_sample(os.getpid(), os.getpid())
        return (
            now.cpu_ns > first.cpu_ns
            and now.switches > first.switches
            and now.run_delay_ns >= first.run_delay_ns
        )

    until(again, "the counts to grow")


def test_a_thread_that_is_not_there_has_an_empty_state() -> None:
    assert vitals.thread_sample(os.getpid(), 1).state == ""


def test_busy_threads_are_counted_without_those_named_and_only_when_asked() -> None:
    me = os.getpid()  # the thread that looks is running
    with asleep() as tid:
        seen = vitals.process_sample(me, MY_START, vitals.Wanted(busy=True))
        assert seen is not None
        assert seen.busy is not None
        assert seen.busy >= 1
        without = vitals.count_busy(me, (me, tid))
        assert without is not None
        assert without < seen.busy or without == 0
    quiet = vitals.process_sample(me, MY_START, vitals.Wanted())
    assert quiet is not None
    assert quiet.busy is None
