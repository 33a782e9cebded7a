"""A core that is to begin and can't reach its database's server: tried again for as long as that lasts, told once."""

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.phases import Phase
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery import plan
from hardcore.recovery.policy import Policy, Word, read_policy
from tests.unit.recovery.play import MS, Play, S, a_page, kinds

AWAY = Diagnosis.STORE_AWAY


def _finds_no_server(play: Play) -> list[orders.Action]:
    play.tell(seen.CoreSpawned(play.now_ns, play.life, 9))
    play.now_ns += 2 * S
    return play.die(seen.Exit(code=69), a_page(0, words="STORE_AWAY"))


def _after_a_crash() -> Play:
    play = Play().begin().running()
    play.die(seen.Exit(signal=11))
    return play


def test_however_often_the_server_is_not_there_it_is_tried_again() -> None:
    play = _after_a_crash()
    pauses = []
    for _ in range(40):
        _finds_no_server(play)
        assert (play.phase, play.manager.reading().waits_for) == (Phase.BACKOFF, None)
        due_ns = play.manager.next_deadline_ns()
        assert due_ns is not None
        pauses.append((due_ns - play.now_ns) // MS)
        play.ring()
        assert play.spawned().safe is None, "without a server there is nothing to read"
    assert pauses[:4] == [500, 1000, 2000, 4000]
    assert max(pauses) == play.policy.backoff_max_ms
    play.running(5)
    assert (play.phase, play.closed().outcome) == (Phase.RUNNING, "recovered")


def test_a_server_that_is_away_costs_no_budget_and_is_announced_once() -> None:
    play = _after_a_crash()
    before = play.manager.reading().deaths
    told = []
    for _ in range(5):
        told += [kind for kind in kinds(_finds_no_server(play)) if kind in {"Alert", "KeepBudget"}]
        play.ring()
    assert told == ["Alert"]
    assert play.manager.reading().deaths == before


def test_at_the_very_first_start_it_is_an_incident_under_its_own_name() -> None:
    play = Play().begin()
    _finds_no_server(play)
    play.ring()
    play.running(1)
    assert play.closed().diagnosis is AWAY


def test_no_policy_gives_up_on_it_or_has_it_read() -> None:
    assert plan.passes(Policy(), AWAY)
    assert not plan.may_read(Policy(), AWAY, tried=False)
    for word in (Word.AWAIT_OPERATOR, Word.SAFE_MODE_ENTER, Word.DEGRADE):
        read = read_policy(f'{{"version": 1, "actions": {{"STORE_AWAY": ["{word}"]}}}}')
        assert isinstance(read, list), word
