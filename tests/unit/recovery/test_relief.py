"""What is done for a core that a restart would not help, fact by fact."""

import pytest

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.actions import AlertStage
from hardcore.model.looks import DiskFacts, ProcessSample
from hardcore.model.phases import Face, HAState, Phase
from hardcore.model.recorder import Beats, LifeState, Threads, Witness
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.policy import Policy, Word
from hardcore.recovery.transitions import Trigger
from tests.unit.recovery.play import MS, PROOF, Play, S, a_page, kinds

FULL, CORRUPT, READ_ONLY = Diagnosis.DISK_FULL, Diagnosis.STORE_CORRUPT, Diagnosis.DISK_READ_ONLY
UNPROVEN = seen.Proof("none", 0, 7, "h7")
ROOM = DiskFacts(free_bytes=1 << 30, read_only=False, write_ns=MS)
NO_ROOM = DiskFacts(free_bytes=1 << 20, read_only=False, write_ns=MS)


def _running() -> Play:
    return Play().begin().running(4)


def _told(play: Play, fault: seen.StoreFault = seen.StoreFault.FULL) -> list[orders.Action]:
    return play.tell(seen.StoreTold(play.now_ns, play.life, fault))


def _switched(play: Play, *, on: bool, done: bool = True) -> list[orders.Action]:
    return play.tell(seen.SafeSwitched(play.now_ns, play.life, on, done))


def _audited(play: Play, fault: str = "event 5 is not what its hash says") -> list[orders.Action]:
    return play.tell(seen.LedgerAudited(play.now_ns, play.life, None, fault))


def _look(play: Play, disk: DiskFacts | None = None) -> list[orders.Action]:
    """A tick of the watch on a core that is well, after a look at the disk."""
    play.now_ns += 100 * MS
    if disk is not None:
        play.tell(seen.Surveyed(play.now_ns, play.life, disk))
    beats = Beats(loop_ns=play.now_ns, thread_ns=play.now_ns, state=LifeState.READY)
    process = ProcessSample("S", 1, 1 << 20, 3)
    return play.tell(seen.Sampled(play.now_ns, play.life, beats, Threads(1, 2, 3), process))


def _reader(play: Play, epoch: int = 4) -> Play:
    """The core that was started to read only is ready."""
    play.tell(seen.CoreSpawned(play.now_ns, play.life, 9))
    play.tell(seen.CoreReady(play.now_ns, play.life, epoch, UNPROVEN))
    return play


def _ring_until(play: Play, phase: Phase) -> None:
    while play.phase is not phase:
        play.ring()


def _state(play: Play) -> tuple[Phase, HAState, Diagnosis | None]:
    reading = play.manager.reading()
    return reading.phase, reading.state, reading.safe


# A trouble without a death.


def test_a_core_that_switched_itself_is_told_as_an_incident_and_lives() -> None:
    play = _running()
    given = _told(play)
    assert kinds(given) == ["Alert", "TakeEvidence"]
    assert _state(play) == (Phase.RUNNING, HAState.SAFE_MODE, FULL)
    assert play.manager.reading().face is Face.FORWARD
    assert play.manager.reading().incident == "i1"


def test_the_evidence_of_a_trouble_is_taken_beside_the_running_core() -> None:
    play = _running()
    (evidence,) = [order for order in _told(play) if isinstance(order, orders.TakeEvidence)]
    assert (evidence.living, evidence.stop, evidence.image) == (True, False, False)


def test_a_disk_without_room_has_the_core_told_to_read_only() -> None:
    play = _running()
    _look(play, NO_ROOM)
    given = _look(play, NO_ROOM)
    assert orders.SetSafe(1, on=True, reason=FULL) in given
    assert play.manager.reading().safe is None
    _switched(play, on=True)
    assert play.manager.reading().state is HAState.SAFE_MODE


def test_what_lasts_is_told_once() -> None:
    play = _running()
    for _ in range(20):
        _look(play, NO_ROOM)
    assert kinds(play.ordered).count("Alert") == 1
    assert kinds(play.ordered).count("TakeEvidence") == 1
    assert kinds(play.ordered).count("SetSafe") == 1


def test_a_policy_that_only_tells_leaves_the_core_as_it_is() -> None:
    tells = Policy(actions={FULL: frozenset({Word.SEND_ALERT})})
    play = Play(tells).begin().running(4)
    _look(play, NO_ROOM)
    assert kinds(_look(play, NO_ROOM)) == ["Alert"]
    assert play.manager.reading().incident == "i1"


def test_a_policy_that_does_nothing_does_nothing() -> None:
    play = Play(Policy(actions={FULL: frozenset({Word.NONE})})).begin().running(4)
    _look(play, NO_ROOM)
    assert _look(play, NO_ROOM) == []
    assert play.manager.reading().incident is None


def test_a_trouble_that_was_ordered_as_a_drill_is_not_announced() -> None:
    play = _running()
    play.tell(seen.DrillStarted(play.now_ns, "diskfull", play.life))
    assert "Alert" not in kinds(_told(play))
    _told(play, seen.StoreFault.OK)
    play.ring()
    assert play.closed().drill == "diskfull"


def test_a_trouble_during_the_probation_closes_the_story_of_the_death_before_it() -> None:
    play = _running()
    play.die()
    play.ready(5)
    _told(play)
    assert (play.closed().id, play.closed().outcome) == ("i1", "recovered")
    assert play.manager.reading().incident == "i2"


def test_a_trouble_is_no_outage() -> None:
    play = _running()
    _told(play)
    assert play.manager.reading().fault_ns is None


def test_evidence_beside_a_core_that_is_being_judged_does_not_end_it() -> None:
    play = Play(Policy(memory_image="on_request")).begin().running(4)
    play.tell(seen.OperatorAsked(play.now_ns, seen.Verb.RESTART_HARD, image=True))
    assert play.phase is Phase.SNAPSHOT_LIVE
    beside = seen.EvidenceTaken(play.now_ns, 1, complete=True, page=None, stopped=False)
    assert play.tell(beside) == []
    assert play.phase is Phase.SNAPSHOT_LIVE


# Its end.


def test_a_full_disk_is_tried_by_itself_and_its_incident_is_closed_when_it_was_calm() -> None:
    play = _running()
    _told(play)
    assert play.ring() == [orders.SetSafe(1, on=False, reason=FULL)]
    _switched(play, on=False)
    assert _state(play) == (Phase.RUNNING, HAState.DEGRADED, None)
    play.ring()
    assert _state(play) == (Phase.RUNNING, HAState.OPERATIONAL, None)
    told = play.closed()
    assert (told.diagnosis, told.outcome, told.deaths) == (FULL, "safe_mode", ())


def test_a_trouble_without_reading_only_ends_as_a_recovery() -> None:
    tells = Policy(actions={FULL: frozenset({Word.SEND_ALERT, Word.DEGRADE})})
    play = Play(tells).begin().running(4)
    _look(play, NO_ROOM)
    _look(play, NO_ROOM)
    assert play.manager.reading().state is HAState.DEGRADED
    _look(play, ROOM)
    play.ring()
    assert play.closed().outcome == "recovered"


def test_a_flickering_trouble_is_one_incident() -> None:
    play = _running()
    for _ in range(5):
        _told(play)
        play.ring()
        _switched(play, on=False)
        _told(play, seen.StoreFault.OK)
        play.now_ns += S
    assert "CloseIncident" not in kinds(play.ordered)
    play.ring()
    assert kinds(play.ordered).count("CloseIncident") == 1
    told = [order.stage for order in play.ordered if isinstance(order, orders.Alert)]
    assert told == [AlertStage.OPENED, AlertStage.CLOSED]


def test_a_disk_that_is_full_again_while_the_trouble_is_not_over_is_read_only_again() -> None:
    play = _running()
    for disk in (NO_ROOM, NO_ROOM):
        _look(play, disk)
    _switched(play, on=True)
    _look(play, ROOM)
    play.ring()
    _switched(play, on=False)
    _look(play, NO_ROOM)
    assert kinds(_look(play, NO_ROOM)) == ["SetSafe"]


def test_a_stop_in_the_middle_of_reading_only_closes_the_story() -> None:
    play = _running()
    _told(play)
    play.ask(seen.Verb.STOP)
    play.die(seen.Exit(code=0))
    assert (play.closed().outcome, play.phase) == ("safe_mode", Phase.STOPPED)


# Deaths in between.


def test_a_death_while_a_trouble_is_on_is_a_story_of_its_own() -> None:
    play = _running()
    _told(play)
    play.now_ns += 100 * S
    play.die()
    trouble = play.closed()
    assert (trouble.diagnosis, trouble.outcome, trouble.deaths) == (FULL, "safe_mode", ())
    assert play.manager.reading().fault_ns == play.now_ns
    died_ns = play.now_ns
    play.running(5)
    death = play.closed()
    assert (death.id, death.diagnosis) == ("i2", Diagnosis.KILLED_FROM_OUTSIDE)
    assert dict(death.timeline)["fault"] == died_ns


def test_a_restart_by_the_operator_while_a_trouble_is_on_is_a_story_of_its_own() -> None:
    play = _running()
    _told(play)
    play.tell(seen.OperatorAsked(play.now_ns, seen.Verb.RESTART, "new code"))
    assert play.closed().diagnosis is FULL
    play.die(seen.Exit(code=0))
    play.running(5)
    told = play.closed()
    assert (told.diagnosis, told.planned, told.reason) == (Diagnosis.OPERATOR, True, "new code")


# A core that can't start.


@pytest.mark.parametrize(("code", "reason"), [(73, FULL), (65, CORRUPT)])
def test_a_core_that_can_not_write_is_followed_by_one_that_reads(code: int, reason: Diagnosis) -> None:
    play = _running()
    play.die()
    play.die(seen.Exit(code=code), a_page(0, words=reason))
    assert play.spawned() == orders.Spawn(3, None, (), safe=reason)
    _reader(play)
    assert orders.Release(3, 4, (), "i1") in play.ordered
    state = HAState.MANUAL_INTERVENTION if reason is CORRUPT else HAState.SAFE_MODE
    assert _state(play) == (Phase.PROBATION, state, reason)
    assert play.manager.reading().waits_for == ("STORE_CORRUPT" if reason is CORRUPT else None)


def _reading() -> Play:
    """A disk was full at the fence; a core serves reads and has lasted."""
    play = _running()
    play.die(page=a_page(4, seq=9))
    play.die(seen.Exit(code=73), a_page(0, words="DISK_FULL"))
    _reader(play).ring()
    assert _state(play) == (Phase.RUNNING, HAState.SAFE_MODE, FULL)
    return play


@pytest.mark.parametrize(("fault", "reason"), [("EROFS", READ_ONLY), ("EIO", READ_ONLY), ("ENOSPC", FULL)])
def test_a_commit_that_failed_on_a_disk_that_refuses_us_too_is_followed_by_a_core_that_reads(
    fault: str, reason: Diagnosis
) -> None:
    play = _running()
    _look(play, DiskFacts(1 << 30, read_only=False, write_ns=MS, fault=fault))
    given = play.die(seen.Exit(code=74), a_page(4, words="COMMIT_FAILED"))
    assert (play.spawned().safe, "KeepBudget" in kinds(given)) == (reason, False)


def test_a_commit_that_failed_on_a_disk_that_takes_our_writes_is_followed_by_a_core_that_writes() -> None:
    play = _running()
    _look(play, ROOM)
    play.die(seen.Exit(code=74), a_page(4, words="COMMIT_FAILED"))
    assert play.spawned().safe is None


def test_what_a_disk_refuses_costs_no_more_than_the_first_death() -> None:
    play = Play(Policy(max_restart_count=1)).begin().running(4)
    play.die(seen.Exit(code=74), a_page(4, words="COMMIT_FAILED"))
    play.die(seen.Exit(code=73), a_page(0, words="DISK_READ_ONLY"))
    assert (play.spawned().safe, play.manager.reading().deaths) == (READ_ONLY, 1)


def test_a_policy_that_tries_again_on_a_full_disk_pays_for_it() -> None:
    play = Play(Policy(actions={FULL: frozenset({Word.REBOOT_PROCESS})})).begin().running(4)
    play.die(seen.Exit(code=73), a_page(0, words="DISK_FULL"))
    assert (play.spawned().safe, play.manager.reading().deaths) == (None, 1)


def test_an_incident_stays_open_while_reads_only_are_served() -> None:
    assert "CloseIncident" not in kinds(_reading().ordered)


def test_a_reader_is_changed_for_a_core_that_writes_when_its_time_has_come() -> None:
    play = _reading()
    assert play.ring() == [orders.Terminate(3)]
    play.die(seen.Exit(code=0))
    assert play.spawned().safe is None
    play.running(5)
    assert _state(play) == (Phase.RUNNING, HAState.OPERATIONAL, None)
    assert (play.closed().id, play.closed().outcome, play.closed().proof) == ("i1", "safe_mode", PROOF)


def test_what_a_reader_says_changes_nothing_that_is_known_of_the_store() -> None:
    play = _reading()
    play.ring()
    play.die(seen.Exit(code=0), a_page(9, seq=99))
    assert play.spawned() == orders.Spawn(4, None, (Witness(9, 4, "h9"),))


def test_the_next_core_still_expects_the_epoch_that_was_known_before_the_reader() -> None:
    play = _running()
    play.die(page=a_page(4, seq=9))
    play.die(seen.Exit(code=73), a_page(4, words="DISK_FULL"))
    _reader(play, epoch=7).ring()
    play.ring()
    play.die(seen.Exit(code=0))
    assert play.spawned().expected_epoch == 4


def test_a_try_that_fails_is_read_only_again_and_neither_counted_nor_announced_nor_recorded() -> None:
    play = _reading()
    play.ring()
    play.die(seen.Exit(code=0))
    deaths = play.manager.reading().deaths
    given = play.die(seen.Exit(code=73), a_page(0, words="DISK_FULL"))
    assert kinds(given) == ["Spawn"]
    assert play.spawned().safe is FULL
    assert play.manager.reading().deaths == deaths


def test_tries_can_fail_for_hours_without_the_guard_giving_up() -> None:
    play = _reading()
    for _ in range(50):
        _ring_until(play, Phase.STOPPING)
        play.die(seen.Exit(code=0))
        _ring_until(play, Phase.STARTING)
        play.die(seen.Exit(code=73), a_page(0, words="DISK_FULL"))
        _reader(play)
    assert play.manager.reading().state is HAState.SAFE_MODE
    assert kinds(play.ordered).count("Alert") == 2


def test_a_reader_that_dies_leaves_nothing_to_try() -> None:
    play = _reading()
    play.die()
    assert play.phase is Phase.FATAL
    assert (play.closed().outcome, play.closed().waits_for) == ("manual", FULL)


def test_a_reader_that_can_not_start_leaves_nothing_to_try() -> None:
    play = _running()
    play.die()
    play.die(seen.Exit(code=73), a_page(0, words="DISK_FULL"))
    play.die(seen.Exit(code=73), a_page(0, words="DISK_FULL"))
    assert play.phase is Phase.FATAL
    assert "Spawn" in kinds(play.ask(seen.Verb.RESUME))
    assert play.spawned().safe is None


def test_a_core_that_writes_and_has_proven_nothing_serves_nobody() -> None:
    play = Play().begin()
    play.tell(seen.CoreReady(play.now_ns, 1, 4, UNPROVEN))
    assert play.phase is Phase.STARTING


def test_a_reader_that_says_it_has_raised_the_epoch_is_not_believed() -> None:
    play = _running()
    play.die()
    play.die(seen.Exit(code=73), a_page(0, words="DISK_FULL"))
    play.tell(seen.EpochRaised(play.now_ns, play.life, 9))
    assert play.phase is Phase.STARTING


# A damaged ledger.


def test_a_ledger_that_is_not_whole_is_read_only_until_a_person_says_otherwise() -> None:
    play = _running()
    assert _audited(play)[-1] == orders.SetSafe(1, on=True, reason=CORRUPT)
    _switched(play, on=True)
    assert _state(play) == (Phase.RUNNING, HAState.MANUAL_INTERVENTION, CORRUPT)
    assert play.manager.reading().waits_for == "STORE_CORRUPT"
    assert kinds(play.ring()) == ["Alert"]  # nobody has come
    assert play.manager.next_deadline_ns() is None
    assert play.ask(seen.Verb.RESUME) == [orders.SetSafe(1, on=False, reason=CORRUPT)]
    _switched(play, on=False)
    assert _state(play) == (Phase.RUNNING, HAState.DEGRADED, None)


def test_what_only_a_person_can_end_is_reported_to_that_person_at_once() -> None:
    play = _running()
    _audited(play)
    assert "CloseIncident" not in kinds(play.ordered)
    _switched(play, on=True)
    told = play.closed()
    assert (told.diagnosis, told.outcome, told.waits_for) == (CORRUPT, "safe_mode", CORRUPT)
    assert told.audit is not None
    assert not told.audit.ok


def test_a_damaged_ledger_that_a_policy_only_tells_of_is_a_persons_at_once() -> None:
    tells = Policy(actions={CORRUPT: frozenset({Word.SEND_ALERT, Word.AWAIT_OPERATOR})})
    play = Play(tells).begin().running(4)
    _audited(play)
    told = [one.stage for one in play.ordered if isinstance(one, orders.Alert)]
    assert told == [AlertStage.OPENED, AlertStage.CLOSED]
    assert (play.closed().outcome, play.closed().waits_for) == ("manual", CORRUPT)
    assert _state(play) == (Phase.RUNNING, HAState.DEGRADED, None)


def test_a_damaged_ledger_at_the_start_is_reported_once_its_reader_has_lasted() -> None:
    play = _running()
    play.die()
    play.die(seen.Exit(code=65), a_page(0, words="STORE_CORRUPT"))
    _reader(play)
    assert "CloseIncident" not in kinds(play.ordered)
    play.ring()
    assert (play.closed().outcome, play.closed().waits_for) == ("safe_mode", CORRUPT)


def test_no_core_writes_to_a_ledger_that_is_known_to_be_damaged() -> None:
    play = _running()
    _audited(play)
    _switched(play, on=True)
    play.die()
    assert play.spawned().safe is CORRUPT
    _reader(play).ring()
    play.ask(seen.Verb.RESTART)
    play.die(seen.Exit(code=0))
    assert play.spawned().safe is CORRUPT
    _reader(play).ring()
    assert play.ask(seen.Verb.RESUME) == [orders.Terminate(play.life)]
    play.die(seen.Exit(code=0))
    assert play.spawned().safe is None


def test_a_person_may_accept_the_ledger_while_reads_are_served() -> None:
    play = _running()
    play.die(page=a_page(4, seq=9))
    play.die(seen.Exit(code=65), a_page(0, words="STORE_CORRUPT"))
    _reader(play).ring()
    play.tell(seen.OperatorAsked(play.now_ns, seen.Verb.RESUME, accept_ledger=True))
    play.die(seen.Exit(code=0))
    assert play.spawned() == orders.Spawn(4, None, ())


def test_a_ledger_is_accepted_only_where_one_is_in_question() -> None:
    play = _running()
    assert not play.manager.reading().in_question
    play.tell(seen.OperatorAsked(play.now_ns, seen.Verb.RESUME, accept_ledger=True))
    play.die(seen.Exit(signal=11))
    known = play.spawned()
    assert known.witnesses, "what was last seen still counts"
    play.die(seen.Exit(code=65), a_page(0, words="STORE_CORRUPT"))
    assert play.manager.reading().in_question


# The state as a value.


def test_a_manager_that_goes_on_from_anothers_state_answers_like_it() -> None:
    one, two = _reading(), Play()
    two.manager.resume(one.manager.state())
    assert two.manager.reading() == one.manager.reading()
    assert two.manager.next_deadline_ns() == one.manager.next_deadline_ns()


def test_every_change_of_phase_on_the_way_has_a_reason() -> None:
    play = _running()
    _told(play)
    play.ring()
    _switched(play, on=False)
    play.ring()
    changes = play.manager.take_transitions()
    assert {Trigger.TROUBLED, Trigger.EASED} <= {change.trigger for change in changes}
    assert all(change.reason for change in changes)
