"""The end of the probation: a core has proven itself when its time is over and it is well."""

import pytest

from hardcore.model import observations as seen
from hardcore.model.phases import Phase
from hardcore.recovery import plan
from hardcore.recovery.policy import Policy
from tests.unit.recovery.play import MS, Play, S, fall_silent, kinds, look


def _again(policy: Policy | None = None) -> Play:
    """A core on probation after a death, which began 100 ms ago."""
    play = Play(policy or Policy())
    play.begin().running().die()
    play.ready(5)
    return play


def _phase(play: Play) -> Phase:
    return play.phase


def test_a_core_that_is_silent_at_the_end_of_its_probation_has_not_proven_itself() -> None:
    play = _again()
    fall_silent(play, 600, 2000)
    assert play.phase is Phase.PROBATION
    assert "CloseIncident" not in kinds(play.ordered)
    fall_silent(play, 600, 2400, first_ms=2000)
    assert _phase(play) is Phase.SNAPSHOT_LIVE


def test_the_successor_of_a_core_that_hung_on_probation_waits_longer_and_longer() -> None:
    play, pauses = _again(), []
    for _ in range(3):
        fall_silent(play, 600, 2200)
        play.tell(seen.EvidenceTaken(play.now_ns, play.life, complete=True, page=None))
        play.die()
        assert play.phase is Phase.BACKOFF
        due_ns = play.manager.next_deadline_ns()
        assert due_ns is not None
        pauses.append((due_ns - play.now_ns) // MS)
        play.ring()
        play.ready(6)
    assert pauses == [500, 1000, 2000]


def test_probation_ends_as_soon_as_the_core_is_well() -> None:
    play = _again()
    fall_silent(play, 1500, 2200)
    assert _phase(play) is Phase.PROBATION
    assert "CloseIncident" in kinds(look(play, 20))
    assert _phase(play) is Phase.RUNNING


def test_a_worry_that_comes_to_nothing_does_not_keep_a_core_on_probation_for_ever() -> None:
    play = _again()
    strange = seen.Conduct(children=("a shell",))
    looks = (play.policy.probation_ms * MS + plan.patience_max_ns(play.policy)) // (100 * MS)
    for _ in range(looks - 1):
        play.tell(seen.Surveyed(play.now_ns, play.life, conduct=strange))
        look(play, 20)
    assert _phase(play) is Phase.PROBATION
    for _ in range(3):
        look(play, 20)
    assert _phase(play) is Phase.SUSPECT


@pytest.mark.parametrize("policy", [Policy(probation_ms=0), Policy(probation_ms=300)])
def test_a_core_that_is_well_has_proven_itself_when_the_time_is_over(policy: Policy) -> None:
    play = _again(policy)
    for _ in range(4):
        look(play, 20)
    assert play.phase is Phase.RUNNING
    assert play.closed().outcome == "recovered"
    assert play.closed().opened_ns >= 100 * S
