"""A lock whose wait is seen from outside: the frame of whoever waits names the lock and the thread that has it."""

import sys
import threading
from types import FrameType

import pytest

from core.guarded.locks import NamedLock
from tests.waiting import until


def frame_of_wait(thread: threading.Thread) -> FrameType | None:
    """Return the frame in which a thread waits for a named lock, None while it does not."""
    frame = sys._current_frames().get(thread.ident or 0)  # as a debugger would
    while frame is not None and frame.f_code.co_name != "wait_for_lock":
        frame = frame.f_back
    return frame


def told(thread: threading.Thread) -> tuple[object, object]:
    frame = frame_of_wait(thread)
    return (frame.f_locals.get("lock_name"), frame.f_locals.get("held_by")) if frame else (None, None)


def test_a_free_lock_is_taken_and_given_back() -> None:
    lock = NamedLock("ring")
    with lock:
        assert lock.held_by == str(threading.get_native_id())
        assert not lock.take(0)
    assert lock.held_by == ""
    assert lock.take(0)


def test_it_is_given_back_also_when_the_work_under_it_fails() -> None:
    lock = NamedLock("ring")
    with pytest.raises(LookupError), lock:
        raise LookupError
    assert lock.held_by == ""


def test_who_waits_shows_the_lock_and_the_thread_that_has_it() -> None:
    lock = NamedLock("ring")

    def want() -> None:
        with lock:
            pass

    waiting = threading.Thread(target=want)
    with lock:
        waiting.start()
        until(lambda: told(waiting) == ("ring", str(threading.get_native_id())), "the wait to be seen")
    waiting.join(20)
    assert not waiting.is_alive()
    assert lock.held_by == ""


def test_a_wait_names_the_thread_that_has_the_lock_now_and_not_the_one_of_long_ago() -> None:
    lock = NamedLock("ring")

    def want() -> None:
        with lock:
            pass

    waiting = threading.Thread(target=want)
    with lock:
        waiting.start()
        until(lambda: told(waiting) == ("ring", str(threading.get_native_id())), "the wait to be seen")
        # Handed on behind its back: were it free for a moment, the one that waits might get it.
        lock._owner = 1
        until(lambda: told(waiting) == ("ring", "1"), "the new owner to be named")
    waiting.join(20)
    assert not waiting.is_alive()


def test_one_thread_at_a_time_is_under_it() -> None:
    lock = NamedLock("ring")
    counted = [0]

    def count() -> None:
        for _ in range(500):
            with lock:
                seen = counted[0]
                counted[0] = seen + 1

    threads = [threading.Thread(target=count) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    assert counted == [2_000]
