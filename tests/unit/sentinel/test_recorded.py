"""The judge over what the real watch of real processes has read (`record.py`)."""

import itertools

import pytest

from hardcore.model.observations import StacksSampled
from hardcore.model.verdicts import Colour, Diagnosis, Grade, Verdict, Wish
from hardcore.sentinel.verdict import Bench
from tests.unit.sentinel import recordings
from tests.unit.sentinel.traces import MS, PATIENCE

HEALTHY = [
    "quiet",
    "dump",
    "collection",
    "stop_short",
    "neighbours",
    "neighbours_dump",
    "neighbours_collection",
]
CERTAIN = {
    "block": Diagnosis.LOOP_BLOCKED,
    "spin": Diagnosis.SPINNING,
    "gil_asleep": Diagnosis.GIL_HELD,
    "gil_locked": Diagnosis.GIL_HELD,
    "gil_computing": Diagnosis.GIL_HELD,
    "slow_transaction": Diagnosis.TRANSACTION_TIMEOUT,
    "deadlock": Diagnosis.DEADLOCK,
    "stop_long": Diagnosis.FROZEN,
}
WITHOUT_STACKS = {
    **{name: (diagnosis, Grade.CERTAIN) for name, diagnosis in CERTAIN.items()},
    "spin": (Diagnosis.SPINNING, Grade.LIKELY),
    "deadlock": (Diagnosis.TRANSACTION_TIMEOUT, Grade.CERTAIN),
}
CONCLUSIVE = ["block", "gil_asleep", "gil_locked", "deadlock", "stop_long"]


def _judged(name: str, *, stacks: bool = True) -> list[tuple[int, Verdict]]:
    bench = Bench(PATIENCE)
    said = []
    for fact in recordings.read(name):
        if isinstance(fact, StacksSampled):
            if stacks:
                bench.hear(fact)
        else:
            said.append((fact.at_ns, bench.judge(fact)))
    return said


def _first_red(name: str, *, stacks: bool = True) -> tuple[int, Verdict]:
    return next((at_ns, v) for at_ns, v in _judged(name, stacks=stacks) if v.colour is Colour.RED)


@pytest.mark.parametrize("name", HEALTHY)
@pytest.mark.parametrize("stacks", [True, False], ids=["with stacks", "without stacks"])
def test_what_only_looks_wrong_is_never_red(name: str, *, stacks: bool) -> None:
    assert Colour.RED not in {verdict.colour for _, verdict in _judged(name, stacks=stacks)}


@pytest.mark.parametrize(("name", "diagnosis"), CERTAIN.items())
def test_a_fault_is_called_by_its_name(name: str, diagnosis: Diagnosis) -> None:
    _, verdict = _first_red(name)
    assert (verdict.diagnosis, verdict.grade) == (diagnosis, Grade.CERTAIN)


@pytest.mark.parametrize(("name", "told"), WITHOUT_STACKS.items())
def test_without_the_right_to_read_stacks_everything_is_still_found(
    name: str, told: tuple[Diagnosis, Grade]
) -> None:
    _, verdict = _first_red(name, stacks=False)
    assert (verdict.diagnosis, verdict.grade) == told


@pytest.mark.parametrize("name", CONCLUSIVE)
def test_what_can_not_end_by_itself_is_called_soon(name: str) -> None:
    at_ns, verdict = _first_red(name)
    assert PATIENCE.conclusive_ms * MS <= at_ns - verdict.fault_ns < PATIENCE.hang_ms * MS


@pytest.mark.parametrize("name", ["spin", "gil_computing"])
def test_what_computes_is_given_the_longer_time(name: str) -> None:
    at_ns, verdict = _first_red(name)
    assert at_ns - verdict.fault_ns >= PATIENCE.hang_ms * MS


@pytest.mark.parametrize("name", ["slow_transaction", "deadlock"])
def test_the_command_that_hangs_is_blamed(name: str) -> None:
    assert _first_red(name)[1].blamed == ("c1",)


def test_a_ring_of_locks_is_told_from_thread_to_thread() -> None:
    whys = {testimony.witness: testimony.why for testimony in _first_red("deadlock")[1].testimonies}
    assert whys["stacks"] in {
        "thread writer waits for theirs held by thread other, which waits for ours held by thread writer",
        "thread other waits for ours held by thread writer, which waits for theirs held by thread other",
    }


@pytest.mark.parametrize("name", [*HEALTHY, *CERTAIN])
def test_stacks_are_asked_for_a_few_times_at_most(name: str) -> None:
    asked = [at_ns for at_ns, verdict in _judged(name) if Wish.STACKS in verdict.wishes]
    assert len(asked) <= 8
    assert all(later - earlier >= 150 * MS for earlier, later in itertools.pairwise(asked))
