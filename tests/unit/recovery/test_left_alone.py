"""A core that hangs and that the policy leaves as it is: nothing is ended, and everybody can see that it waits."""

import pytest

from hardcore.model.phases import HAState, Phase
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery import plan
from hardcore.recovery.policy import HUNG, Policy, Word
from tests.unit.recovery.play import Play, fall_silent, kinds, look

BLOCKED = Diagnosis.LOOP_BLOCKED


@pytest.mark.parametrize(
    "words",
    [{Word.SEND_ALERT}, {Word.SEND_ALERT, Word.AWAIT_OPERATOR}, {Word.NONE}],
    ids=["told", "told and waited for", "nothing"],
)
def test_a_hang_that_nothing_is_done_about_waits_for_a_person(words: set[Word]) -> None:
    play = Play(Policy(actions={BLOCKED: frozenset(words)})).begin().running()
    fall_silent(play, 100, 3000)
    reading = play.manager.reading()
    assert (reading.state, reading.waits_for) == (HAState.MANUAL_INTERVENTION, BLOCKED)
    assert {"Kill", "SetSafe", "Terminate"}.isdisjoint(kinds(play.ordered))
    for _ in range(200):
        look(play, 20)
    reading = play.manager.reading()
    assert (reading.phase, reading.state, reading.waits_for) == (Phase.RUNNING, HAState.OPERATIONAL, None)


def test_what_is_to_be_shown_as_degraded_is() -> None:
    play = Play(Policy(actions={BLOCKED: frozenset({Word.DEGRADE})})).begin().running()
    fall_silent(play, 100, 4000)
    assert play.manager.reading().state is HAState.DEGRADED


@pytest.mark.parametrize("diagnosis", sorted(HUNG))
def test_by_default_no_hang_is_left_alone(diagnosis: Diagnosis) -> None:
    assert not plan.left_alone(Policy(), diagnosis)


def test_what_passes_by_itself_waits_for_nobody_unless_the_policy_says_so() -> None:
    tells, waits = frozenset({Word.SEND_ALERT}), frozenset({Word.AWAIT_OPERATOR})
    assert not plan.left_alone(Policy(actions={Diagnosis.DB_LOCKED: tells}), Diagnosis.DB_LOCKED)
    assert plan.left_alone(Policy(actions={Diagnosis.DB_LOCKED: waits}), Diagnosis.DB_LOCKED)
