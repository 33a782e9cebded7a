from hardcore.model.observations import Probed
from hardcore.model.recorder import Beats, Witness
from hardcore.sentinel.witnesses import answers as witness
from hardcore.sentinel.witnesses.answers import Answers, Unkept
from tests.unit.sentinel.traces import MS, seen


def _look(
    answers: Answers, at_ms: int, answered: int, committed: int | None, since_ms: int = 0
) -> Unkept | None:
    last = None if committed is None else Witness(committed, 4, "ab")
    return answers.look(Beats(answered_seq=answered), last, seen(at_ms, since_ms=since_ms))


def test_more_answered_than_committed_is_a_claim_that_is_not_kept() -> None:
    answers = Answers()
    _look(answers, 1000, 5, 5)
    _look(answers, 1100, 7, 5)
    assert _look(answers, 1200, 7, 5) == Unkept(7, 5, 200 * MS, 1000 * MS)


def test_a_commit_ends_it() -> None:
    answers = Answers()
    for at_ms in (1000, 1100):
        _look(answers, at_ms, 7, 5)
    assert _look(answers, 1200, 7, 7) is None
    found = _look(answers, 1300, 8, 7)
    assert found is not None
    assert found.for_ns == 100 * MS


def test_without_anything_to_compare_with_nothing_is_said() -> None:
    assert _look(Answers(), 1000, 7, None) is None


def test_the_cores_own_head_counts_if_it_was_asked_after_the_claim() -> None:
    answers = Answers()
    _look(answers, 1000, 7, None)
    answers.hear(Probed(950 * MS, 1, 900 * MS, answered=True, seq=5))
    assert _look(answers, 1100, 7, None) is None
    answers.hear(Probed(1200 * MS, 1, 1150 * MS, answered=True, seq=5))
    assert _look(answers, 1200, 7, None) is not None
    answers.hear(Probed(1300 * MS, 1, 1250 * MS, answered=True, seq=7))
    assert _look(answers, 1300, 7, None) is None


def test_time_before_an_amnesty_does_not_count() -> None:
    answers = Answers()
    _look(answers, 1000, 7, 5)
    found = _look(answers, 1100, 7, 5, since_ms=1050)
    assert found is not None
    assert found.for_ns == 50 * MS


def test_it_is_worth_saying_only_after_a_while() -> None:
    assert witness.testify(Unkept(7, 5, 299 * MS, 0), 300) is None
    assert witness.testify(Unkept(7, 5, 300 * MS, 0), 300) is not None
