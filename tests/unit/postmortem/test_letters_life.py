import pytest

from frontend.catalogue_letters import REFUSALS
from postmortem.dead_letters.life import LIFE, Trigger, after
from postmortem.views import LetterState


def test_the_life_of_a_letter_is_total() -> None:
    assert set(LIFE) == {(state, trigger) for state in LetterState for trigger in Trigger}


@pytest.mark.parametrize(
    "code", sorted({code for code in LIFE.values() if not isinstance(code, LetterState)})
)
def test_whatever_can_not_happen_has_its_sentence(code: str) -> None:
    assert code in REFUSALS


@pytest.mark.parametrize("state", LetterState)
def test_only_a_core_that_has_it_resolves_a_letter(state: LetterState) -> None:
    for trigger in Trigger:
        if after(state, trigger) is LetterState.RESOLVED and state is not LetterState.RESOLVED:
            assert trigger is Trigger.CONFIRMED


def test_a_letter_that_is_being_retried_is_in_nobody_elses_hands() -> None:
    for trigger in (Trigger.RETRY, Trigger.HOLD, Trigger.DISCARD, Trigger.UNDO):
        assert after(LetterState.RETRYING, trigger) == "letter_busy"


@pytest.mark.parametrize("state", LetterState)
def test_what_was_discarded_comes_back_only_by_a_persons_word_or_the_ledgers(state: LetterState) -> None:
    for trigger in Trigger:
        if state is LetterState.DISCARDED and after(state, trigger) is not LetterState.DISCARDED:
            moved = trigger in (Trigger.UNDO, Trigger.UNDO_HELD, Trigger.CONFIRMED)
            assert moved or isinstance(after(state, trigger), str)


@pytest.mark.parametrize("trigger", [Trigger.DECLINED, Trigger.UNCERTAIN, Trigger.CAME_BACK])
def test_a_retry_that_was_not_done_leaves_the_letter_in_the_queue(trigger: Trigger) -> None:
    assert after(LetterState.RETRYING, trigger) is LetterState.QUARANTINED
