import pytest

from core.imports.outcomes import Booked, Duplicate, settle
from core.imports.reading.candidates import Skip, SkippedRow
from core.imports.records import PROBLEMS_MAX, Problem, Progress
from core.imports.states import TABLE, State, Trigger, after


def test_a_committed_import_never_becomes_a_preview_again() -> None:
    for (state, _), then in TABLE.items():
        assert then is not State.PREVIEW or state is State.PREVIEW


def test_an_end_stays_an_end() -> None:
    for state in (State.DONE, State.FAILED):
        assert {after(state, trigger) for trigger in Trigger} <= {state, None}


@pytest.mark.parametrize("state", [State.COMMITTING, State.DONE, State.FAILED])
def test_another_choice_for_a_committed_import_is_refused(state: State) -> None:
    assert after(state, Trigger.COMMIT) is state
    assert after(state, Trigger.COMMIT_OTHERWISE) is None
    assert after(state, Trigger.READ_AGAIN) is None


def test_every_state_can_be_reached() -> None:
    assert {State.PREVIEW, *TABLE.values()} == set(State)


def test_settled_rows_add_up_whatever_becomes_of_them() -> None:
    problem = Problem(3, "no-date", ("x",))
    progress = Progress()
    for outcome in (Booked(), Duplicate(), problem, SkippedRow(4, ("",), Skip.BLANK), Booked()):
        progress = settle(progress, outcome)
    counts = (progress.booked, progress.duplicates, progress.refused, progress.skipped)
    assert counts == (2, 1, 1, 1)
    assert progress.done == sum(counts)
    assert progress.problems == (problem,)


def test_problems_are_counted_past_the_number_that_is_kept() -> None:
    progress = Progress()
    for line in range(PROBLEMS_MAX + 5):
        progress = settle(progress, Problem(line, "no-date", ()))
    assert progress.refused == PROBLEMS_MAX + 5
    assert len(progress.problems) == PROBLEMS_MAX
