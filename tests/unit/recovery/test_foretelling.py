"""What is done about what will run out: told once, changed for another core where that helps, and judged."""

import dataclasses

import pytest

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.forecasts import Resource
from hardcore.model.looks import DiskFacts, ProcessSample
from hardcore.model.phases import Phase
from hardcore.model.recorder import Beats, LifeState, Threads
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery import flight, foretelling, succession
from hardcore.recovery.foresight import Foresight, Judgement, numbers
from hardcore.recovery.policy import Policy, Word
from tests.unit.recovery.play import MS, Play, S, drained, kinds, proven, raised

MIB = 1 << 20
QUICK = Policy(
    forecast_interval_sec=1, forecast_warmup_sec=2, forecast_confirm_sec=3, forecast_horizon_sec=60
)
TOLD_ONLY = Policy(
    forecast_interval_sec=1,
    forecast_warmup_sec=2,
    forecast_confirm_sec=3,
    forecast_horizon_sec=60,
    actions={Diagnosis.LEAK: frozenset({Word.SEND_ALERT})},
)


def _spared(policy: Policy) -> Play:
    return Play(policy).begin().running(4).spared()


def _pass(
    play: Play,
    seconds: int,
    rss_mib: float,
    grows: float = 0.0,
    disk: DiskFacts | None = None,
    disk_grows: int = 0,
    fds: int = 40,
    fds_grow: int = 0,
    calm: bool = False,
) -> list[orders.Action]:
    """Some seconds of looks at a core that answers; return what was ordered."""
    given: list[orders.Action] = []
    for step in range(10 * seconds):
        play.now_ns += 100 * MS
        due_ns = play.manager.next_deadline_ns()
        if due_ns is not None and due_ns <= play.now_ns:
            play.manager.handle_deadline(play.now_ns)
            given += play.tell()
        held = int((rss_mib + grows * step / 10) * MIB)
        beats = Beats(loop_ns=play.now_ns, thread_ns=play.now_ns, state=LifeState.READY, completed=step)
        process = ProcessSample("S", 1, held, 3, fds=fds + fds_grow * step // 10)
        given += play.tell(seen.Sampled(play.now_ns, play.life, beats, Threads(1, 3, 2), process))
        if play.spare:
            given += play.glance()
        if step % 10 == 0:
            now = (
                None
                if disk is None
                else DiskFacts(
                    disk.free_bytes - disk_grows * step // 10, False, 1, size_bytes=disk.size_bytes
                )
            )
            given += play.tell(seen.Surveyed(play.now_ns, play.life, now, free_bytes=8 << 30, fds_limit=1024))
            if calm:
                given += play.tell(seen.GatewayCounted(play.now_ns, 0, 0, 7))
        if play.phase is not Phase.RUNNING:
            return given
    return given


def _forecasts(given: list[orders.Action]) -> list[orders.Alert]:
    return [one for one in given if isinstance(one, orders.Alert) and one.stage is orders.AlertStage.FORECAST]


def _changed(play: Play, epoch: int) -> None:
    """The core is drained, the spare takes over and outlasts its probation; the old one leaves."""
    left = play.life
    assert "Promote" in kinds(drained(play))
    raised(play, epoch)
    proven(play, epoch)
    play.ring()
    play.tell(seen.CoreExited(play.now_ns, left, seen.Exit(code=0), None))


def test_a_leak_is_told_once_with_what_it_was_made_from() -> None:
    play = _spared(TOLD_ONLY)
    told = _forecasts(_pass(play, 45, 200, grows=5))
    assert [one.diagnosis for one in told] == [Diagnosis.LEAK]
    assert "512 MiB" in told[0].text
    (forecast,) = play.manager.reading().forecasts
    assert forecast.resource is Resource.MEMORY
    assert 0 < forecast.per_hour_low <= forecast.per_hour
    assert forecast.due_ns <= forecast.due_late_ns


def test_a_core_that_is_well_is_told_of_in_no_way() -> None:
    play = _spared(QUICK)
    assert _forecasts(_pass(play, 60, 200, calm=True)) == []
    assert play.manager.reading().forecasts == ()
    assert play.phase is Phase.RUNNING


def test_a_policy_that_only_tells_changes_no_core() -> None:
    play = _spared(TOLD_ONLY)
    given = _pass(play, 50, 200, grows=5, calm=True)
    assert _forecasts(given)
    assert "Drain" not in kinds(given)


def test_a_core_that_leaks_is_changed_for_another_in_a_calm_moment_before_its_limit() -> None:
    play = _spared(QUICK)
    given = _pass(play, 55, 200, grows=5, calm=True)
    assert "Drain" in kinds(given)
    _changed(play, 5)
    assert play.manager.reading().forecasts == ()
    incident = play.closed()
    assert incident.diagnosis is Diagnosis.LEAK
    assert incident.planned


def test_nobody_is_changed_while_somebody_is_there_and_there_is_time() -> None:
    play = _spared(QUICK)
    assert "Drain" not in kinds(_pass(play, 45, 200, grows=5))


def test_a_switch_after_which_it_began_no_lower_is_said_and_not_repeated() -> None:
    play = _spared(QUICK)
    _pass(play, 55, 200, grows=5, calm=True)
    _changed(play, 5)
    given = _pass(play, 3, 440, grows=2, calm=True)
    play.spared()
    given += _pass(play, 30, 446, grows=2, calm=True)
    assert any("begun no lower" in one.text for one in _forecasts(given))
    assert "Drain" not in kinds(given)


def test_a_leak_that_goes_on_in_each_core_is_switched_for_so_often_in_a_day() -> None:
    play = _spared(QUICK)
    for turn in range(QUICK.forecast_switches_max):
        assert "Drain" in kinds(_pass(play, 60, 200, grows=5, calm=True))
        _changed(play, 5 + turn)
        play.spared()
    given = _pass(play, 55, 200, grows=5, calm=True)
    assert _forecasts(given)
    assert "Drain" not in kinds(given)


def test_a_switch_that_could_not_be_done_is_none_of_the_days_and_is_tried_again_after_a_pause(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(succession, "RELIEF_AGAIN_NS", 5 * S)
    monkeypatch.setattr(foretelling, "AGAIN_NS", S)
    play = _spared(dataclasses.replace(QUICK, forecast_switches_max=1))
    assert "Drain" in kinds(_pass(play, 55, 200, grows=5, calm=True))
    for _ in range(succession.DRAINS_MAX - 1):
        drained(play, done=False)
        assert "Drain" in kinds(_pass(play, 5, 480, grows=1, calm=True))
    drained(play, done=False)
    assert "Drain" not in kinds(_pass(play, 4, 485, grows=1, calm=True)), "it pauses"
    assert "Drain" in kinds(_pass(play, 20, 489, grows=1, calm=True)), "and was not the one of the day"
    _changed(play, 5)
    play.spared()
    assert "Drain" not in kinds(_pass(play, 55, 200, grows=5, calm=True)), "that was the one of the day"


def test_descriptors_run_out_as_memory_does() -> None:
    play = _spared(QUICK)
    told = _forecasts(_pass(play, 50, 200, fds=500, fds_grow=10))
    assert [one.diagnosis for one in told] == [Diagnosis.FD_EXHAUSTION]


def test_a_disk_that_fills_is_told_of_and_no_core_is_changed_for_it() -> None:
    play = _spared(QUICK)
    disk = DiskFacts(8 << 30, False, 1, size_bytes=20 << 30)
    given = _pass(play, 50, 200, disk=disk, disk_grows=140 * MIB, calm=True)
    assert [one.diagnosis for one in _forecasts(given)] == [Diagnosis.DISK_FULL]
    assert "Drain" not in kinds(given)


def test_memory_that_it_shares_with_others_does_not_count_once_its_own_is_known() -> None:
    play = _spared(TOLD_ONLY)
    for second in range(50):
        play.tell(seen.Surveyed(play.now_ns, play.life, free_bytes=8 << 30, private_bytes=90 * MIB))
        _pass(play, 1, 200 + 5 * second)
    assert play.manager.reading().forecasts == ()


def test_what_was_seen_is_on_the_tape_and_can_be_gone_on_with() -> None:
    play = _spared(TOLD_ONLY)
    _pass(play, 45, 200, grows=5)
    told = flight.CODEC.decode(flight.state_of(play.manager))
    other = Play(TOLD_ONLY)
    assert flight.resume(other.manager, told) is None
    assert other.manager.reading().forecasts == play.manager.reading().forecasts != ()


def test_a_switch_that_did_not_help_one_resource_forbids_none_for_another() -> None:
    sight = Foresight()
    sight.begin(1, 0, numbers(QUICK))
    sight.judgement = Judgement(Resource.THREADS, 100, 1)
    sight.begin(2, MS, numbers(QUICK))
    assert sight.begins_no_lower(Resource.THREADS, 100, 2_000 * MS) is not None
    assert sight.in_vain(Resource.THREADS, 3_000 * MS)
    assert not sight.in_vain(Resource.MEMORY, 3_000 * MS)
