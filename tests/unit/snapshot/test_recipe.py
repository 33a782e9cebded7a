import itertools
from collections.abc import Mapping

import pytest

from hardcore.snapshot import recipe
from hardcore.snapshot.recipe import DEAD, LIVING, LOOKED_AT, Piece

MS = 1_000_000


@pytest.mark.parametrize("shares", [LIVING, LOOKED_AT, DEAD])
def test_the_disk_is_left_a_share_of_every_budget(shares: Mapping[Piece, int]) -> None:
    steps = recipe.plan(shares, start_ns=0, budget_ms=400)
    assert steps[-1].until_ns < recipe.cut_ns(0, 400) < recipe.end_ns(0, 400)
    assert all(before.until_ns < after.until_ns for before, after in itertools.pairwise(steps))


def test_what_a_stop_would_destroy_is_taken_before_it() -> None:
    order = list(LIVING)
    before = {Piece.THREADS, Piece.ASK, Piece.TASKS, Piece.TRACEBACK}
    assert set(order[: order.index(Piece.STOP)]) == before


def test_where_the_threads_sleep_is_read_before_a_signal_wakes_one() -> None:
    assert next(iter(LIVING)) is Piece.THREADS


def test_the_cheap_pieces_are_taken_while_the_debugger_reads() -> None:
    order = list(LIVING)
    cheap = set(order[order.index(Piece.DEBUGGER) + 1 : order.index(Piece.STACKS)])
    assert cheap == {Piece.RECORDER, Piece.PROCESS, Piece.LOG}


def test_what_the_kernel_may_keep_to_itself_is_waited_for_last() -> None:
    assert list(LIVING)[-2:] == [Piece.LOCKS, Piece.MEMORY]


def test_a_core_that_serves_on_is_looked_at_in_the_same_way_and_not_stopped() -> None:
    assert [piece for piece in LIVING if piece not in LOOKED_AT] == [Piece.STOP]


def test_a_dead_core_is_neither_stopped_nor_asked() -> None:
    assert not {Piece.STOP, Piece.ASK, Piece.TASKS, Piece.DEBUGGER, Piece.THREADS} & set(DEAD)
    assert next(iter(DEAD)) is Piece.RECORDER


def test_every_piece_has_its_place() -> None:
    assert set(LIVING) | set(DEAD) == set(Piece)


def test_a_budget_counts_from_its_start() -> None:
    early, late = (recipe.plan(LIVING, start_ns=at, budget_ms=100) for at in (0, 7 * MS))
    assert [step.until_ns + 7 * MS for step in early] == [step.until_ns for step in late]


def test_a_piece_that_waits_for_an_answer_has_no_more_than_its_own_share() -> None:
    tasks = next(step for step in recipe.plan(LIVING, start_ns=0, budget_ms=400) if step.piece is Piece.TASKS)
    assert tasks.patience_ns(7) == 7 + 32 * MS


@pytest.mark.parametrize(("begun_ms", "until_ms"), [(0, 20), (10, 30), (395, 400)])
def test_a_piece_that_is_begun_late_has_its_share_as_far_as_the_whole_allows(
    begun_ms: int, until_ms: int
) -> None:
    first = recipe.plan(LIVING, start_ns=0, budget_ms=400)[0]
    assert first.deadline_ns(begun_ms * MS, 400 * MS) == until_ms * MS
