"""The end of the probation: a core has proven itself when its time is over and it is well."""

import pytest

from hardcore.model import observations as seen
from hardcore.model.clocks import Clocks
from hardcore.model.looks import Conduct, ProcessSample
from hardcore.model.phases import Phase
from hardcore.model.recorder import Beats, LifeState, Threads
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
    strange = Conduct(children=("a shell",))
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


def _silent_in_held_interpreter(
    play: Play, at_ms: int, *, slept_ms: int = 0, loop_ns: int | None = None
) -> None:
    """A tick at which both beats have been silent since 600; `loop_ns`: what somebody wrote in the place of one."""
    play.now_ns += 100 * MS
    silent_ns = play.now_ns - (at_ms - 600) * MS
    beats = Beats(
        loop_ns=silent_ns if loop_ns is None else loop_ns, thread_ns=silent_ns, state=LifeState.READY
    )
    clocks = Clocks(play.now_ns + slept_ms * MS, play.now_ns + slept_ms * MS)
    process = ProcessSample("R", play.now_ns // 2, 1 << 20, 3)
    play.tell(seen.Sampled(play.now_ns, play.life, beats, Threads(1, 3, 2), process, clocks=clocks))
    due_ns = play.manager.next_deadline_ns()
    if due_ns is not None and due_ns <= play.now_ns:
        play.manager.handle_deadline(play.now_ns)
        play.tell()


def test_silence_that_is_forgiven_proves_nothing() -> None:
    play = _again(Policy(confirm_hang_ms=60_000))
    # Its time is over at 2600; shortly before that the machine has slept.
    for at_ms in range(700, 2900, 100):
        _silent_in_held_interpreter(play, at_ms, slept_ms=60_000 if at_ms >= 2500 else 0)
    assert play.phase is Phase.PROBATION
    assert "CloseIncident" not in kinds(play.ordered)


def test_a_beat_from_the_future_does_not_hide_the_silence_after_it() -> None:
    play = _again(Policy(confirm_hang_ms=60_000, gc_grace_ms=100, transaction_timeout_ms=100))
    _silent_in_held_interpreter(play, 700, loop_ns=1 << 62)
    for at_ms in range(800, 90_000, 100):
        if play.phase is not Phase.PROBATION:
            break
        _silent_in_held_interpreter(play, at_ms)
    assert "CloseIncident" not in kinds(play.ordered)
