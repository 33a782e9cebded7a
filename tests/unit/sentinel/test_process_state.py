from hardcore.model.looks import ProcessSample, ThreadSample
from hardcore.model.verdicts import Colour
from hardcore.sentinel.witnesses import process_state
from hardcore.sentinel.witnesses.process_state import ProcessFacts, ProcessState, Sleep
from tests.unit.sentinel.traces import MS, seen


def _facts(*looks: tuple[str, ThreadSample | None], since_ms: int = 0) -> ProcessFacts:
    state = ProcessState()
    found = None
    for n, (letter, loop) in enumerate(looks, start=1):
        sample = ProcessSample(letter, 0, 1, 4, None, loop, loop)
        found = state.look(sample, seen(n * 100, since_ms=since_ms))
    assert found is not None
    return found


def _sleep(waits_in: str, cpu_ns: int = 5, state: str = "S") -> tuple[str, ThreadSample]:
    return ("S", ThreadSample(state, cpu_ns, waits_in))


def test_one_look_says_nothing() -> None:
    facts = _facts(("T", None))
    assert not facts.stopped
    assert _facts(_sleep("futex")).loop is Sleep.NOT


def test_two_looks_that_agree_say_since_when() -> None:
    facts = _facts(("S", None), ("T", None), ("T", None), ("T", None))
    assert facts.stopped
    assert facts.stopped_ns == 200 * MS


def test_a_stop_that_was_interrupted_begins_anew() -> None:
    facts = _facts(("T", None), ("T", None), ("S", None), ("T", None), ("T", None))
    assert facts.stopped_ns == 100 * MS


def test_a_lock_or_a_timer_is_conclusive() -> None:
    for place in ("futex_wait_queue", "futex_do_wait", "hrtimer_nanosleep", "do_nanosleep"):
        assert _facts(_sleep(place), _sleep(place)).loop is Sleep.CONCLUSIVE


def test_any_other_wait_is_not() -> None:
    for place in ("ep_poll", "poll_schedule_timeout", "unix_stream_read_generic", "pipe_read", ""):
        assert _facts(_sleep(place), _sleep(place)).loop is Sleep.OTHER


def test_processor_time_between_two_looks_is_no_sleep() -> None:
    assert _facts(_sleep("futex", 5), _sleep("futex", 6)).loop is Sleep.NOT


def test_another_place_is_another_sleep() -> None:
    facts = _facts(_sleep("futex"), _sleep("futex"), _sleep("ep_poll"), _sleep("ep_poll"))
    assert (facts.loop, facts.loop_ns) == (Sleep.OTHER, 100 * MS)


def test_a_disk_wait_or_a_runnable_thread_is_never_asleep() -> None:
    for letter in ("D", "R", "t", "Z", "I"):
        assert _facts(_sleep("futex", state=letter), _sleep("futex", state=letter)).loop is Sleep.NOT


def test_a_thread_is_gone_when_two_looks_found_none() -> None:
    gone = ("S", ThreadSample("", 0, ""))
    assert _facts(_sleep("futex"), gone).writer is Sleep.NOT
    assert _facts(_sleep("futex"), gone, gone).writer is Sleep.GONE


def test_a_look_that_did_not_look_closer_ends_the_sleep() -> None:
    facts = _facts(_sleep("futex"), _sleep("futex"), ("S", None), _sleep("futex"))
    assert (facts.loop, facts.loop_ns) == (Sleep.NOT, 0)


def test_what_was_before_the_amnesty_does_not_count() -> None:
    looks = [_sleep("futex")] * 5
    assert _facts(*looks, since_ms=400).loop_ns == 100 * MS
    assert _facts(*[("T", None)] * 5, since_ms=400).stopped_ns == 100 * MS


def test_a_loop_that_waits_for_work_is_green() -> None:
    facts = _facts(_sleep("ep_poll"), _sleep("ep_poll"))
    assert process_state.testify(facts, beating=True).colour is Colour.GREEN
    assert process_state.testify(facts, beating=False).colour is Colour.RED


def test_a_stopped_process_is_red_whatever_its_beats_say() -> None:
    assert process_state.testify(_facts(("T", None), ("T", None)), beating=True).colour is Colour.RED
