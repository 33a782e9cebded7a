from hardcore.model.verdicts import Wish
from hardcore.recovery.curiosity import ANSWER_NS, Curiosity

BOTH = frozenset(Wish)


def test_each_question_is_out_once_at_a_time() -> None:
    curiosity = Curiosity()
    assert set(curiosity.ask(BOTH, 0)) == BOTH
    assert curiosity.ask(BOTH, 1) == ()


def test_an_answer_makes_room_for_its_own_question_only() -> None:
    curiosity = Curiosity()
    curiosity.ask(BOTH, 0)
    curiosity.answered(Wish.STACKS)
    assert curiosity.ask(BOTH, 1) == (Wish.STACKS,)


def test_a_question_that_nobody_answers_is_asked_again_after_its_time() -> None:
    curiosity = Curiosity()
    curiosity.ask(BOTH, 0)
    assert curiosity.ask(BOTH, ANSWER_NS - 1) == ()
    assert set(curiosity.ask(BOTH, ANSWER_NS)) == BOTH
