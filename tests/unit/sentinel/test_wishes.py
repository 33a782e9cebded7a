import itertools

from hardcore.model.verdicts import Wish
from hardcore.sentinel.verdict import Bench
from tests.unit.sentinel import traces
from tests.unit.sentinel.traces import PATIENCE, Look, deciding_since, queued, silent, well


def _asked(looks: list[Look], wish: Wish = Wish.STACKS) -> list[int]:
    bench = Bench(PATIENCE)
    return [look.at_ms for look in looks if wish in bench.judge(look.sampled()).wishes]


def _busy(from_ms: int, for_ms: int) -> list[Look]:
    return silent(from_ms, for_ms, Look(0, state="R", loop=traces.UNSCHEDULED))


def test_a_healthy_core_leaves_nothing_open() -> None:
    assert _asked(well(5000)) == []
    assert _asked(well(5000), Wish.STORE) == []


def test_stacks_are_asked_for_as_soon_as_the_loop_is_late() -> None:
    assert _asked(well(1000) + _busy(1000, 1000))[0] == 1370


def test_a_few_more_are_asked_for_at_growing_pauses_and_then_none() -> None:
    asked = _asked(well(1000) + _busy(1000, 20_000))
    assert asked == [1370, 1570, 1970, 2370]


def test_a_machine_where_suspicions_come_and_go_is_not_asked_all_the_time() -> None:
    looks = well(1000)
    for begin_ms in range(1000, 21_000, 500):
        looks += [*_busy(begin_ms, 400), Look(begin_ms + 470)]
    asked = _asked(looks)
    assert 2 <= len(asked) <= 11
    assert all(later - earlier >= 2000 for earlier, later in itertools.pairwise(asked))


def test_a_collection_of_memory_and_a_stop_are_no_riddles() -> None:
    collecting = silent(1000, 3000, Look(0, state="R", loop=traces.UNSCHEDULED, gc_since_ms=1010))
    assert _asked(well(1000) + collecting) == []
    assert len(_asked(well(1000) + silent(1000, 600, Look(0, state="T", loop=traces.STOPPED)))) == 0


def test_a_command_whose_thread_sleeps_on_a_lock_is_looked_at() -> None:
    looks = [
        Look(at, submitted=1, notes=deciding_since(100), deciding=traces.LOCKED) for at in range(0, 900, 100)
    ]
    assert _asked(looks)[0] == 400


def test_a_core_that_waits_in_the_store_lets_the_lock_be_looked_at() -> None:
    looks = [Look(at, submitted=1, in_store_ms=100, notes=queued(0)) for at in range(0, 2000, 100)]
    assert _asked(looks, Wish.STORE) == [400, 900, 1400, 1900]


def test_a_command_that_is_being_decided_is_not_waiting_in_the_store() -> None:
    looks = [
        Look(at, submitted=1, in_store_ms=100, notes=deciding_since(100), deciding=traces.NAPPING)
        for at in range(0, 900, 100)
    ]
    assert _asked(looks, Wish.STORE) == []


def test_nothing_is_asked_twice_because_we_overslept() -> None:
    looks = [*well(1000), *_busy(1000, 400)]
    assert _asked([*looks, Look(1900, 900, loop=traces.UNSCHEDULED, state="R")]) == [1370]
