import itertools

import pytest

from hardcore.snapshot import recipe
from hardcore.snapshot.recipe import DEAD, LIVING, Piece

MS = 1_000_000


@pytest.mark.parametrize("living", [True, False])
def test_the_disk_is_left_a_share_of_every_budget(living: bool) -> None:
    steps = recipe.plan(living=living, start_ns=0, budget_ms=400)
    assert steps[-1].until_ns < recipe.end_ns(0, 400)
    assert all(before.until_ns < after.until_ns for before, after in itertools.pairwise(steps))


def test_what_a_stop_would_destroy_is_taken_before_it() -> None:
    order = list(LIVING)
    assert order.index(Piece.THREADS) < order.index(Piece.STOP)
    assert order.index(Piece.TRACEBACK) < order.index(Piece.STOP)
    assert all(order.index(Piece.STOP) < order.index(piece) for piece in (Piece.RECORDER, Piece.STACKS))


def test_a_dead_core_is_neither_stopped_nor_asked() -> None:
    assert not {Piece.STOP, Piece.TRACEBACK, Piece.STACKS, Piece.THREADS} & set(DEAD)
    assert next(iter(DEAD)) is Piece.RECORDER


def test_every_piece_has_its_place() -> None:
    assert set(LIVING) | set(DEAD) == set(Piece)


def test_a_budget_counts_from_its_start() -> None:
    early, late = (recipe.plan(living=True, start_ns=at, budget_ms=100) for at in (0, 7 * MS))
    assert [step.until_ns + 7 * MS for step in early] == [step.until_ns for step in late]
