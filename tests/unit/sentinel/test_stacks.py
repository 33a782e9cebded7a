import pytest

from hardcore.model.looks import StackFrame, ThreadStack
from hardcore.model.observations import StacksSampled
from hardcore.model.verdicts import Colour
from hardcore.sentinel.witnesses import stacks as witness
from hardcore.sentinel.witnesses.stacks import StackFacts, Stacks, find_cycle
from tests.unit.sentinel.traces import MS


def _frame(function: str, line: int = 1, **names: str) -> StackFrame:
    return StackFrame(function, "app.py", line, tuple(names.items()))


def _thread(tid: int, *frames: StackFrame, active: bool = False, gil: bool = False) -> ThreadStack:
    return ThreadStack(tid, f"t{tid}", active, gil, frames)


def _waits(tid: int, lock: str, held_by: str, above: int = 0) -> ThreadStack:
    frames = [_frame(f"c{n}") for n in range(above)]
    return _thread(tid, *frames, _frame("wait_for_lock", lock_name=lock, held_by=held_by), _frame("run"))


def _found(*looks: tuple[ThreadStack, ...], at_ms: int = 0, silent_ms: int = 0) -> StackFacts:
    stacks = Stacks()
    for n, threads in enumerate(looks):
        stacks.hear(StacksSampled((1000 + 200 * n) * MS, 1, threads))
    return stacks.find(1, silent_ms * MS, (at_ms or 1000 + 200 * len(looks)) * MS)


def test_two_threads_that_wait_for_each_other_are_a_ring() -> None:
    cycle = find_cycle((_waits(3, "a", "4"), _waits(4, "b", "3")))
    assert cycle is not None
    assert cycle.named
    assert cycle.tids == {3, 4}
    assert str(cycle) == "thread t3 waits for a held by thread t4, which waits for b held by thread t3"


def test_three_in_a_ring_are_found_and_who_only_waits_for_them_is_not_in_it() -> None:
    ring = (_waits(3, "a", "4"), _waits(4, "b", "5"), _waits(5, "c", "3"))
    cycle = find_cycle((_waits(1, "a", "3"), *ring))
    assert cycle is not None
    assert cycle.tids == {3, 4, 5}


def test_a_chain_that_ends_is_no_ring() -> None:
    assert find_cycle((_waits(3, "a", "4"), _waits(4, "b", "5"))) is None
    assert find_cycle((_waits(3, "a", "4"), _thread(4, _frame("compute"), active=True))) is None


@pytest.mark.parametrize("held_by", ["", "''", "somebody", "3"])
def test_a_lock_that_nobody_else_is_known_to_have_is_no_ring(held_by: str) -> None:
    assert find_cycle((_waits(3, "a", held_by), _waits(4, "b", "3"))) is None


def test_values_in_quotes_are_read() -> None:
    assert find_cycle((_waits(3, "'a'", "'4'"), _waits(4, '"b"', '"3"'))) is not None


def test_a_locks_frame_may_stand_under_a_few_others_and_not_under_many() -> None:
    assert find_cycle((_waits(3, "a", "4", above=3), _waits(4, "b", "3"))) is not None
    assert find_cycle((_waits(3, "a", "4", above=9), _waits(4, "b", "3"))) is None


def test_two_sleepers_that_show_the_same_two_locks_are_a_likely_ring() -> None:
    locks = {"first": "<unlocked _thread.lock object at 0x7f01>", "second": "<_thread.lock object at 0x7f02>"}
    sleepers = (_thread(3, _frame("f", 1, **locks)), _thread(4, _frame("g", 1, **locks)))
    cycle = find_cycle(sleepers)
    assert cycle is not None
    assert not cycle.named
    assert find_cycle((sleepers[0], _thread(4, _frame("g", 1, **locks), active=True))) is None
    assert find_cycle((sleepers[0], _thread(4, _frame("g", first=locks["first"])))) is None


RING = (_waits(3, "a", "4"), _waits(4, "b", "3"))


def test_a_ring_is_one_only_if_two_looks_in_a_row_agree() -> None:
    assert _found(RING).cycle is None
    assert _found(RING, (_waits(3, "a", "4"),), RING).cycle is None
    found = _found(RING, RING)
    assert found.cycle is not None
    assert found.cycle_since_ns == 1000 * MS


def test_a_ring_seen_long_ago_says_nothing_about_now() -> None:
    assert _found(RING, RING, at_ms=9000).cycle is None


OUTER = (_frame("handle", 7), _frame("main", 1))


def _loop(*frames: StackFrame) -> tuple[ThreadStack, ...]:
    return (_thread(1, *frames, gil=True),)


def test_a_loop_that_moves_in_its_own_frame_is_in_the_same_place() -> None:
    found = _found(_loop(_frame("spin", 5), *OUTER), _loop(_frame("help"), _frame("spin", 6), *OUTER))
    assert found.loop_same is True
    assert found.gil == "t1"


def test_a_loop_called_from_elsewhere_is_in_another_place() -> None:
    deep = tuple(_frame(f"d{n}") for n in range(5))
    assert _found(_loop(*deep, _frame("handle", 7)), _loop(*deep, _frame("handle", 9))).loop_same is False


def test_one_look_compares_with_nothing() -> None:
    assert _found(_loop(*OUTER)).loop_same is None


def test_a_look_from_before_the_silence_is_the_past() -> None:
    assert _found(_loop(*OUTER), _loop(*OUTER), silent_ms=1100).loop_same is None


def test_a_look_that_showed_nothing_is_none() -> None:
    assert _found(RING, (), RING).cycle is not None


def test_only_a_bounded_number_of_looks_is_kept() -> None:
    stacks = Stacks()
    for n in range(50):
        stacks.hear(StacksSampled(n * MS, 1, RING))
    assert len(stacks._looks) == witness.LOOKS_MAX


def test_it_says_what_it_found_and_nothing_else() -> None:
    assert witness.testify(StackFacts()) is None
    elsewhere = witness.testify(StackFacts(loop_same=False, where="f (app.py:1)"))
    assert elsewhere is not None
    assert elsewhere.colour is Colour.GREEN
    ring = witness.testify(_found(RING, RING))
    assert ring is not None
    assert ring.colour is Colour.YELLOW
