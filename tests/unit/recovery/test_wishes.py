"""What the judge wishes to know, whom a hang names, and when memory is kept, fact by fact."""

import pytest
from msgspec import structs

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.looks import ProcessSample, ThreadSample
from hardcore.model.phases import Phase
from hardcore.model.recorder import Beats, LifeState, Threads
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.policy import Policy
from tests.unit.recovery.play import MS, Play, S, a_page, deciding, kinds


def _running() -> Play:
    return Play().begin().running(4)


def _overdue(play: Play) -> list[orders.Action]:
    """A tick that finds a command still being decided, long after it began, by a thread that sleeps on a lock."""
    play.now_ns += 100 * MS
    began_ns = 101 * S
    note = structs.replace(
        deciding("k"), started_ns=began_ns, stage_ns=began_ns, limit_ns=S, thread=3, command_id="c-slow"
    )
    beats = Beats(loop_ns=play.now_ns, thread_ns=play.now_ns, submitted=1, state=LifeState.READY)
    sleeps = ThreadSample("S", 5, "futex_wait_queue")
    process = ProcessSample("S", 1, 1 << 20, 3, writer=sleeps, deciding=((3, sleeps),))
    return play.tell(seen.Sampled(play.now_ns, play.life, beats, Threads(1, 3, 2), process, (note,)))


def test_a_hang_names_the_commands_that_its_evidence_names() -> None:
    play = _running()
    for _ in range(60):
        if play.phase is not Phase.SNAPSHOT_LIVE:
            _overdue(play)
    play.tell(seen.EvidenceTaken(play.now_ns, 1, complete=True, page=a_page(4, deciding("k"))))
    play.die()
    play.running(5)
    told = play.closed()
    assert (told.diagnosis, told.blamed) == (Diagnosis.TRANSACTION_TIMEOUT, ("c-slow",))
    assert told.suspects == ("k",)


def test_what_the_judge_wishes_is_asked_once_at_a_time() -> None:
    play = _running()
    given = [order for _ in range(6) for order in _overdue(play)]
    assert kinds(given) == ["SampleStacks"]


def test_an_image_of_the_memory_is_taken_before_the_kill_when_a_person_asks_and_the_policy_allows() -> None:
    play = Play(Policy(memory_image="on_request")).begin().running(4)
    asked = seen.OperatorAsked(play.now_ns, seen.Verb.RESTART_HARD, image=True)
    (evidence,) = play.tell(asked)
    assert isinstance(evidence, orders.TakeEvidence)
    assert (evidence.living, evidence.stop, evidence.image) == (True, True, True)
    taken = seen.EvidenceTaken(play.now_ns, 1, complete=True, page=None)
    assert play.tell(taken) == [orders.Kill(1)]
    play.die()
    play.running(5)
    assert (play.closed().planned, play.closed().outcome) == (True, "recovered")


@pytest.mark.parametrize("phase_rings", [0, 1])
def test_a_policy_that_allows_no_image_kills_at_once(phase_rings: int) -> None:
    play = Play().begin().ready(4)
    for _ in range(phase_rings):
        play.ring()
    asked = seen.OperatorAsked(play.now_ns, seen.Verb.RESTART_HARD, image=True)
    assert play.tell(asked) == [orders.Kill(1)]


def test_there_is_no_image_of_a_core_that_never_served() -> None:
    play = Play(Policy(memory_image="on_request")).begin()
    asked = seen.OperatorAsked(play.now_ns, seen.Verb.RESTART_HARD, image=True)
    assert play.tell(asked) == [orders.Kill(1)]


def test_a_policy_that_always_wants_an_image_takes_it_with_the_evidence_of_a_hang() -> None:
    play = Play(Policy(memory_image="always")).begin()
    (evidence,) = [order for order in play.ring() if isinstance(order, orders.TakeEvidence)]
    assert evidence.image
    due_ns = play.manager.next_deadline_ns()
    assert due_ns is not None
    assert due_ns - play.now_ns > play.policy.memory_image_budget_ms * MS
