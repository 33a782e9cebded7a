"""A part of the core that stands still is begun anew alone; and a switch that no person asked for waits for a calm moment."""

from msgspec import structs

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.looks import ProcessSample
from hardcore.model.phases import SERVING
from hardcore.model.recorder import Beats, ComponentBeat, LifeState, Threads
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.policy import Policy, Word
from hardcore.recovery.repair import RESTARTS_OF_A_LIFE_MAX, Repair
from tests.unit.recovery.play import MS, POLLS, Play, S, drained, kinds, proven, raised

STALLED = Diagnosis.COMPONENT_STALLED
LIMIT_NS = 2 * S
ALONE = Policy(actions={STALLED: frozenset({Word.SEND_ALERT, Word.RESTART_COMPONENT})})
ENDED = {"Kill", "Terminate", "Drain"}


def _running(policy: Policy | None = None) -> Play:
    return Play(policy or Policy()).begin().running()


def _look(play: Play, *parts: ComponentBeat, rss_bytes: int = 1 << 20) -> list[orders.Action]:
    """A tick 100 ms later; a deadline that has come rings first."""
    play.now_ns += 100 * MS
    due_ns = play.manager.next_deadline_ns()
    if due_ns is not None and due_ns <= play.now_ns:
        play.manager.handle_deadline(play.now_ns)
    beats = Beats(loop_ns=play.now_ns, thread_ns=play.now_ns, state=LifeState.READY)
    process = ProcessSample("S", 1, rss_bytes, 3, loop=POLLS, writer=POLLS)
    told = seen.Sampled(play.now_ns, play.life, beats, Threads(1, 3, 2), process)
    return play.tell(structs.replace(told, components=parts))


def _part(beat_ns: int, since_ns: int | None = None) -> ComponentBeat:
    return ComponentBeat("importer", beat_ns, beat_ns if since_ns is None else since_ns, LIMIT_NS, 3)


def _stall(play: Play, until_s: float = 2.5) -> list[orders.Action]:
    beat_ns, given = play.now_ns, []
    for _ in range(int(until_s * 10)):
        given += _look(play, _part(beat_ns))
        if play.spare:
            play.glance()
    return given


def _answered(play: Play, *, done: bool = True) -> list[orders.Action]:
    fact = seen.ComponentRestarted(play.now_ns, play.life, "importer", done, "" if done else "it holds on")
    return play.tell(fact)


def test_a_part_that_stands_still_is_begun_anew_alone_and_its_incident_has_no_outage() -> None:
    play = _running()
    assert orders.RestartComponent(1, "importer") in _stall(play)
    _answered(play)
    for _ in range(120):
        _look(play, _part(play.now_ns))
    told = play.closed()
    assert (told.diagnosis, told.outcome, told.deaths) == (STALLED, "recovered", ())
    assert not ENDED & set(kinds(play.ordered))
    assert play.phase in SERVING


def test_a_part_that_works_or_has_nothing_to_do_is_left_alone() -> None:
    play = _running()
    for _ in range(50):
        _look(play, _part(play.now_ns))
    for _ in range(50):
        _look(play, _part(1, since_ns=0))
    assert "RestartComponent" not in kinds(play.ordered)


def test_time_that_nobody_was_there_to_see_is_not_held_against_a_part() -> None:
    play = _running()
    beat_ns = play.now_ns
    _look(play, _part(beat_ns))
    play.now_ns += 60 * S
    for _ in range(5):
        _look(play, _part(beat_ns))
    assert "RestartComponent" not in kinds(play.ordered)


def test_a_part_that_can_not_be_begun_anew_costs_a_switch_and_no_kill() -> None:
    play = _running().spared()
    _stall(play)
    _answered(play, done=False)
    play.tell(seen.GatewayCounted(play.now_ns, 0, 0, 3))
    play.glance()
    assert "Drain" in kinds(_stall(play, 3))
    drained(play)
    raised(play, 5)
    proven(play, 5)
    play.ring()
    told = play.closed()
    assert (told.diagnosis, told.planned, told.outcome) == (STALLED, True, "recovered")
    assert "Kill" not in kinds(play.ordered)


def test_a_part_is_begun_anew_three_times_in_the_window_and_no_more() -> None:
    play = _running(ALONE)
    for _ in range(6):
        _stall(play, 6)
        _answered(play)
    assert kinds(play.ordered).count("RestartComponent") == 3
    assert play.phase in SERVING


def test_an_order_that_is_not_answered_is_as_good_as_refused() -> None:
    play = _running(ALONE)
    _stall(play, 20)
    assert kinds(play.ordered).count("RestartComponent") == 1


def test_a_guard_that_watches_only_waits_for_a_word() -> None:
    play = _running(Policy(mode="assist"))
    assert "RestartComponent" not in kinds(_stall(play))
    assert kinds(play.ask(seen.Verb.RESUME)) == ["RestartComponent"]


def test_a_part_that_a_person_wants_begun_anew_is_an_incident_of_its_own() -> None:
    play = _running()
    asked = seen.OperatorAsked(play.now_ns, seen.Verb.RESTART_COMPONENT, "stuck", component="importer")
    assert play.tell(asked) == [orders.RestartComponent(1, "importer")]
    _answered(play)
    told = play.closed()
    assert (told.diagnosis, told.planned, told.outcome) == (Diagnosis.OPERATOR, True, "recovered")
    assert "serving" not in dict(told.timeline)


# ---- a switch that no person asked for ----


def _grown(play: Play, seconds: int, forwarded: int | None = None) -> list[orders.Action]:
    """So many seconds with more memory than is allowed; `forwarded`: the gateway counts so many each second."""
    given: list[orders.Action] = []
    for _ in range(seconds):
        if forwarded is not None:
            play.tell(seen.GatewayCounted(play.now_ns, 5, 0, forwarded))
        if play.spare:
            play.glance()
        for _ in range(10):
            given += _look(play, rss_bytes=2 << 30)
    return given


def test_more_memory_than_allowed_is_worth_another_core_once_nothing_is_asked() -> None:
    play = _running().spared()
    for forwarded in range(15):
        assert "Drain" not in kinds(_grown(play, 1, forwarded))
    _grown(play, 5, 14)
    assert kinds(play.ordered).count("Drain") == 1
    told = [one.diagnosis for one in play.ordered if isinstance(one, orders.Alert)]
    assert told == [Diagnosis.MEMORY_PRESSURE]


def test_without_a_calm_moment_it_is_done_all_the_same_once_the_patience_is_over() -> None:
    play = _running().spared()
    assert "Drain" not in kinds(_grown(play, 40))
    _grown(play, 40)
    assert kinds(play.ordered).count("Drain") == 1


def test_a_guard_that_watches_only_changes_no_core_for_its_memory() -> None:
    play = _running(Policy(mode="assist"))
    _grown(play, 90)
    assert not ENDED & set(kinds(play.ordered))


def test_a_part_that_may_be_silent_for_longer_than_the_window_is_not_begun_anew_for_ever() -> None:
    slow = ComponentBeat("auditor", 1, 1, 30 * S, 0)
    repair = Repair(beats=(slow,))
    for n in range(3):
        assert not repair.is_spent("auditor", n * 35 * S, 60 * S)
        repair.order("auditor", n * 35 * S, asked=False)
    assert repair.is_spent("auditor", 3 * 35 * S, 60 * S)


def test_a_part_is_begun_anew_only_so_often_in_one_life_however_seldom() -> None:
    repair, hour_ns = Repair(), 3_600 * S
    for n in range(RESTARTS_OF_A_LIFE_MAX):
        assert not repair.is_spent("importer", n * hour_ns, 60 * S)
        repair.order("importer", n * hour_ns, asked=False)
    assert repair.is_spent("importer", 100 * hour_ns, 60 * S)
