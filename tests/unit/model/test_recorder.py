from hardcore.model.recorder import Beats


def test_what_has_a_slot_and_no_answer_waits() -> None:
    assert Beats(submitted=5, completed=3).waiting == 2


def test_a_torn_count_never_makes_less_than_nothing_wait() -> None:
    assert Beats(submitted=3, completed=5).waiting == 0
