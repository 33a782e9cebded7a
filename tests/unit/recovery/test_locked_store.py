"""A core that is to write and finds the ledger's lock with another program: waited for, named, read meanwhile."""

import dataclasses
import json

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.looks import LockHolder
from hardcore.model.phases import HAState, Phase
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.policy import Policy, Word, in_full
from tests.unit.recovery.play import MS, Play, S, a_page, kinds

UNPROVEN = seen.Proof("none", 0, 7, "h7")
BACKUP = LockHolder(4711, "backup")
LOCKED = Diagnosis.DB_LOCKED


def _only_told() -> Policy:
    return Policy(actions={LOCKED: frozenset({Word.SEND_ALERT})})


def _meets_the_lock(play: Play, *holders: LockHolder) -> list[orders.Action]:
    """The core that was started waits at its fence, says so, and leaves; then the look at the lock comes back."""
    play.tell(seen.CoreSpawned(play.now_ns, play.life, 9))
    play.now_ns += 2 * S
    life = play.life
    given = play.tell(seen.FenceBlocked(play.now_ns, life))
    given += play.die(seen.Exit(code=69), a_page(0, words="DB_LOCKED"))
    return given + play.tell(seen.StoreLooked(play.now_ns, life, holders or (BACKUP,)))


def _reads(play: Play) -> Play:
    """The reader that was started is ready and outlasts its probation."""
    assert play.spawned().safe is LOCKED
    play.tell(seen.CoreSpawned(play.now_ns, play.life, 9))
    play.tell(seen.CoreReady(play.now_ns, play.life, 4, UNPROVEN))
    play.ring()
    return play


def _after_a_crash(policy: Policy | None = None) -> Play:
    play = Play(policy or Policy()).begin().running()
    play.die(seen.Exit(signal=11))
    return play


def test_a_core_that_meets_a_lock_at_its_start_is_never_given_up() -> None:
    play = _after_a_crash(_only_told())
    pauses = []
    for _ in range(40):
        _meets_the_lock(play)
        assert play.phase is Phase.BACKOFF
        due_ns = play.manager.next_deadline_ns()
        assert due_ns is not None
        pauses.append((due_ns - play.now_ns) // MS)
        play.ring()
    assert pauses[:4] == [500, 1000, 2000, 4000]
    assert max(pauses) == play.policy.backoff_max_ms
    play.running(5)
    assert (play.phase, play.closed().outcome) == (Phase.RUNNING, "recovered")


def test_starts_that_a_lock_prevents_cost_no_budget_and_are_announced_once() -> None:
    play = _after_a_crash(_only_told())
    before = play.manager.reading().deaths
    alerts = []
    for _ in range(5):
        alerts += [
            kind for kind in kinds(_meets_the_lock(play)) if kind in {"Alert", "KeepBudget", "TakeEvidence"}
        ]
        play.ring()
    assert alerts == ["Alert"]
    assert play.manager.reading().deaths == before


def test_whoever_holds_the_lock_is_named() -> None:
    play = _after_a_crash(_only_told())
    assert "LookAtStore" in kinds(_meets_the_lock(play))
    named = "process 4711 (backup) holds the store's write lock"
    assert play.manager.reading().locked_by == named
    play.ring()
    play.running(5)
    assert named in [fact.why for fact in play.closed().evidence]
    assert play.manager.reading().locked_by is None


def test_a_lock_at_the_very_first_start_is_an_incident_that_names_it_too() -> None:
    play = Play(_only_told()).begin()
    play.tell(seen.CoreSpawned(play.now_ns, 1, 9), seen.FenceBlocked(play.now_ns, 1))
    play.tell(seen.StoreLooked(play.now_ns, 1, (BACKUP,)))
    play.die(seen.Exit(code=69), a_page(0, words="DB_LOCKED"))
    play.ring()
    play.running(1)
    assert play.closed().diagnosis is LOCKED
    assert any("4711" in fact.why for fact in play.closed().evidence)


def test_reads_are_served_while_another_program_holds_the_lock() -> None:
    play = _after_a_crash()
    _meets_the_lock(play)
    _reads(play)
    reading = play.manager.reading()
    assert (reading.state, reading.safe, reading.waits_for) == (HAState.SAFE_MODE, LOCKED, None)
    assert reading.locked_by is not None


def test_a_reader_makes_room_for_a_writer_only_when_the_lock_is_free() -> None:
    play = _after_a_crash()
    _meets_the_lock(play)
    _reads(play)
    for _ in range(100):
        assert kinds(play.ring()) == ["LookAtStore"]
        assert play.tell(seen.StoreLooked(play.now_ns, play.life, (BACKUP,))) == []
    assert kinds(play.ring()) == ["LookAtStore"]
    assert play.tell(seen.StoreLooked(play.now_ns, play.life, ())) == [orders.Terminate(play.life)]
    play.die(seen.Exit(code=0))
    assert play.spawned().safe is None
    play.running(5)
    assert (play.phase, play.closed().outcome) == (Phase.RUNNING, "safe_mode")


def test_a_try_that_meets_the_lock_again_is_read_only_again() -> None:
    play = _after_a_crash()
    _meets_the_lock(play)
    _reads(play)
    play.ring()
    play.tell(seen.StoreLooked(play.now_ns, play.life, ()))
    play.die(seen.Exit(code=0))
    assert {"Alert", "KeepBudget"}.isdisjoint(kinds(_meets_the_lock(play)))
    _reads(play)


def test_where_not_even_reading_is_possible_a_core_that_writes_is_tried_again() -> None:
    play = _after_a_crash()
    _meets_the_lock(play)
    assert play.spawned().safe is LOCKED
    _meets_the_lock(play)
    assert play.phase is Phase.BACKOFF
    play.ring()
    assert play.spawned().safe is None


def test_readers_that_crash_are_counted_as_any_other_core() -> None:
    play = _after_a_crash(Policy(max_restart_count=2))
    for _ in range(2):
        _meets_the_lock(play)
        play.die(seen.Exit(signal=11))
        if play.phase is Phase.BACKOFF:
            play.ring()
    assert play.manager.reading().waits_for == "CRASH_LOOP"


def test_a_policy_that_wants_a_person_gets_one() -> None:
    play = _after_a_crash(Policy(actions={LOCKED: frozenset({Word.AWAIT_OPERATOR})}))
    _meets_the_lock(play)
    assert (play.phase, play.manager.reading().waits_for) == (Phase.FATAL, "DB_LOCKED")


def test_a_serving_core_that_ends_as_if_locked_is_a_death_like_any_other() -> None:
    play = Play(_only_told()).begin().running()
    before = play.manager.reading().deaths
    play.die(seen.Exit(code=69), a_page(4, words="DB_LOCKED"))
    assert play.manager.reading().deaths == before + 1


def test_a_reader_that_died_in_a_mode_that_leaves_it_is_replaced_once_the_mode_is_act_again() -> None:
    play = _after_a_crash()
    _meets_the_lock(play)
    _reads(play)
    for mode in ("observe", "act"):
        policy = dataclasses.replace(play.policy, mode=mode)
        play.tell(seen.PolicyRead(play.now_ns, json.dumps(in_full(policy))))
        if mode == "observe":
            play.die()
            assert play.phase is Phase.FATAL
    assert "Spawn" in kinds(play.ring())
