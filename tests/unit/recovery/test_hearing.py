"""What a death, a trial and a conviction mean for everything else the guard does."""

import pytest
from msgspec import structs

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model import trials
from hardcore.model.phases import Phase
from hardcore.model.recorder import CommandNote, SlotStage
from hardcore.model.trials import Ordeal
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.policy import Policy
from tests.unit.recovery.play import MS, Play, S, a_page, deciding, kinds

SEGV = seen.Exit(signal=11)
KILLED = seen.Exit(signal=9)


def _released(play: Play) -> orders.Release:
    return [order for order in play.ordered if isinstance(order, orders.Release)][-1]


def _budget(play: Play) -> tuple[int, ...]:
    return [order for order in play.ordered if isinstance(order, orders.KeepBudget)][-1].deaths_ns


def _died(*names: str, play: Play | None = None, epoch: int = 4) -> Play:
    """A proven core crashed while it decided these, and another serves."""
    play = play or Play().begin().running(epoch)
    play.now_ns += S
    play.die(SEGV, a_page(epoch, *map(deciding, names), seq=9))
    return play.ready(epoch + 1)


def _filed(play: Play, *names: str) -> list[orders.Action]:
    return play.tell(*(trials.CaseFiled(play.now_ns, name, "browser:1", "d") for name in names))


def _tried(
    play: Play, name: str, ordeal: Ordeal, signal: int | None = None, seq: int | None = None
) -> list[orders.Action]:
    return play.tell(trials.Tried(play.now_ns, name, ordeal, 7, signal=signal, seq=seq))


def _over(play: Play, fault: str = "") -> list[orders.Action]:
    return play.tell(trials.TrialsOver(play.now_ns, fault))


def test_suspects_are_written_down_before_anything_is_released() -> None:
    play = _died("a")
    names = kinds(play.ordered)
    assert names.index("KeepCourt") < len(names) - 1 - names[::-1].index("Release")
    assert _released(play).suspects == ("a",)


@pytest.mark.parametrize("how", [KILLED, seen.Exit(code=75), seen.Exit(code=74)])
def test_a_death_from_outside_makes_no_suspects(how: seen.Exit) -> None:
    play = Play().begin().running(4)
    play.die(how, a_page(4, deciding("a"), seq=9))
    assert _released(play.ready(5)).suspects == ()


def test_trials_begin_when_a_core_serves_and_the_cases_are_there() -> None:
    play = Play().begin().running(4)
    play.die(SEGV, a_page(4, deciding("a"), seq=9))
    assert "Try" not in kinds(_filed(play, "a")), "nobody serves yet"
    assert "Try" in kinds(play.ready(5).ordered)
    order = next(one for one in play.ordered if isinstance(one, trials.Try))
    policy = Policy()
    assert order.limit_ms == 3 * policy.transaction_timeout_ms
    assert order.memory_bytes == policy.memory_limit_mb << 20


def test_the_death_of_a_core_does_not_end_a_court() -> None:
    play = _died("a")
    _filed(play, "a")
    given = play.die(KILLED, a_page(5, seq=9))
    assert "EndTrials" not in kinds(given)
    assert "SetAside" in kinds(_tried(play, "a", Ordeal.DIED, signal=11))


def test_a_death_that_a_conviction_explains_leaves_the_budget() -> None:
    play = _died("a")
    assert len(_budget(play)) == 1
    _filed(play, "a")
    _tried(play, "a", Ordeal.DIED, signal=11)
    assert _budget(play) == ()


def test_a_death_that_no_trial_explains_stays_on_the_budget() -> None:
    play = _died("a")
    _filed(play, "a")
    _tried(play, "a", Ordeal.SURVIVED)
    assert len(_budget(play)) == 1


def test_a_guard_that_gave_up_over_explained_deaths_tries_again() -> None:
    play = _died("a", play=Play(Policy(max_restart_count=1, slow_retry_sec=0)).begin().running(4))
    _filed(play, "a")
    play.die(SEGV, a_page(5, deciding("b"), seq=9))
    assert "TryLog" not in kinds(play.ordered)
    assert play.manager.reading().waits_for == Diagnosis.CRASH_LOOP
    assert play.manager.next_deadline_ns() is not None, "the court's own time"
    _tried(play, "a", Ordeal.DIED, signal=11)
    play.ring()
    assert play.phase is Phase.STARTING


def test_what_came_of_the_trials_stands_in_the_incident() -> None:
    play = _died("a")
    _filed(play, "a")
    given = _tried(play, "a", Ordeal.DIED, signal=11)
    told = next(one for one in given if isinstance(one, trials.AddTrials))
    play.ring()
    assert play.closed().trials == told.trials
    assert (told.incident, told.trials[0].ordeal) == (play.closed().id, Ordeal.DIED)


def test_who_is_in_the_ledger_is_no_suspect() -> None:
    play = _died("a")
    given = play.tell(trials.SuspectsSettled(play.now_ns, ("a",)))
    assert [one.suspects for one in given if isinstance(one, trials.KeepCourt)] == [()]


# ---- the log ----


def _booting() -> Play:
    """A proven core was replaced, and its successor has not raised its epoch yet."""
    play = Play().begin().running(4)
    play.die(KILLED, a_page(4, seq=9))
    play.tell(seen.CoreSpawned(play.now_ns, play.life, 9))
    return play


@pytest.mark.parametrize("how", [SEGV, seen.Exit(code=1)])
def test_a_start_that_dies_waits_for_the_log_to_be_tried(how: seen.Exit) -> None:
    play = _booting()
    log = next(one for one in play.die(how) if isinstance(one, trials.TryLog))
    assert (log.after_seq, play.phase) == (0, Phase.BACKOFF)
    assert "Spawn" not in kinds(_tried(play, "", Ordeal.DIED, signal=11, seq=812))
    play.now_ns += S
    _over(play)
    assert "Spawn" in kinds(play.ring())
    letter = next(one.letter for one in play.ordered if isinstance(one, trials.SetAside))
    assert (letter.seq, letter.held) == (812, False)


def test_a_start_does_not_wait_for_ever() -> None:
    play = _booting()
    play.die(SEGV)
    due_ns = play.manager.next_deadline_ns()
    assert due_ns is not None
    assert due_ns - play.now_ns <= Policy().startup_timeout_ms * MS
    assert "Spawn" in kinds(play.ring())


def test_a_start_waits_for_its_pause_all_the_same() -> None:
    play = _booting()
    began_ns = play.now_ns
    play.die(SEGV)
    _over(play)
    play.ring()
    assert play.now_ns - began_ns == Policy().backoff_initial_ms * MS


@pytest.mark.parametrize("how", [KILLED, seen.Exit(code=69), seen.Exit(code=78)])
def test_a_start_that_ends_for_another_reason_waits_for_nobody(how: seen.Exit) -> None:
    assert "TryLog" not in kinds(_booting().die(how))


def test_the_log_is_tried_once_in_an_incident_unless_something_was_found() -> None:
    play = _booting()
    play.die(SEGV)
    _over(play)
    play.ring()
    play.tell(seen.CoreSpawned(play.now_ns, play.life, 9))
    assert "TryLog" not in kinds(play.die(SEGV))


@pytest.mark.parametrize("found", [True, False])
def test_the_log_is_tried_again_if_it_was_not_tried_or_an_event_was_found(found: bool) -> None:
    play = _booting()
    play.die(SEGV)
    if found:
        _tried(play, "", Ordeal.DIED, signal=11, seq=812)
    _over(play, "" if found else "no room")
    play.ring()
    play.tell(seen.CoreSpawned(play.now_ns, play.life, 9))
    assert "TryLog" in kinds(play.die(SEGV))


def test_a_spare_that_dies_keeps_nobody_waiting() -> None:
    play = Play().begin().running(4).spared()
    play.die(KILLED, a_page(4, seq=9))
    assert play.phase is Phase.SWITCHING
    given = play.die(SEGV)
    assert {"TryLog", "Spawn"} <= set(kinds(given))


def test_a_stop_is_not_kept_waiting_by_the_log() -> None:
    play = _booting()
    play.die(SEGV)
    assert "Halt" in kinds(play.ask(seen.Verb.STOP))


# ---- delayed ----


def test_a_core_that_dies_early_with_nobody_at_work_clears_the_suspects_and_has_the_log_tried() -> None:
    play = _died("a")
    _filed(play, "a")
    given = play.die(SEGV, a_page(5, seq=9))
    assert [one.run for one in given if isinstance(one, trials.Acquit)] == [True]
    assert "EndTrials" in kinds(given)
    log = next(one for one in _over(play) if isinstance(one, trials.TryLog))
    assert log.after_seq == 7, "what the last core that outlived its probation held then"


def test_a_core_that_dies_long_after_its_probation_says_nothing_of_the_log() -> None:
    play = Play().begin().running(4)
    play.now_ns += 60 * S
    assert not {"TryLog", "Acquit"} & set(kinds(play.die(SEGV, a_page(4, seq=9))))


def test_a_death_soon_after_a_suspect_was_cleared_is_early() -> None:
    play = _died("a")
    play.now_ns += 5 * S
    play.ring()
    _filed(play, "a")
    _tried(play, "a", Ordeal.SURVIVED)
    _over(play)
    assert "TryLog" in kinds(play.die(SEGV, a_page(5, seq=9)))


def test_what_was_finished_shortly_before_three_deaths_is_told_as_likely() -> None:
    play = Play().begin().running(4)
    for epoch in range(4, 7):
        play.now_ns += 60 * S
        done = CommandNote(SlotStage.FREE, "c", "k1", "rates.set", "", (), play.now_ns - S)
        old = CommandNote(SlotStage.FREE, "c", "k2", "old", "", (), play.now_ns - 3 * S)
        play.die(SEGV, structs.replace(a_page(epoch, seq=9), finished=(done, old)))
        play.running(epoch + 1)
    near = [one.why for one in play.closed().evidence if one.witness == "near"]
    assert [why.split(" had ")[0] for why in near] == ["kind rates.set", "request k1"]


# ---- guards that come and go, people ----


def test_a_successor_knows_whom_the_guard_before_suspected() -> None:
    memory = [one.memory for one in _died("a").ordered if isinstance(one, trials.KeepCourt)][-1]
    play = Play()
    page = a_page(6, seq=9)
    play.tell(seen.SentinelBegan(play.now_ns, page=page, adoptable=page, court=memory))
    assert _released(play).suspects == ("a",)
    assert "Try" in kinds(_filed(play, "a"))


def test_whom_nobody_brings_is_let_go_if_no_death_counts_against_it() -> None:
    play = Play()
    page = a_page(6, seq=9)
    play.tell(seen.SentinelBegan(play.now_ns, page=page, adoptable=page, suspects=("k1",)))
    given = play.ring()
    assert [(one.name, one.run) for one in given if isinstance(one, trials.Acquit)] == [("k1", False)]


def test_a_rule_that_a_person_removed_makes_a_fresh_start() -> None:
    play = _died("a")
    _filed(play, "a")
    letter = next(
        x.letter for x in _tried(play, "a", Ordeal.DIED, signal=11) if isinstance(x, trials.SetAside)
    )
    given = play.tell(trials.RuleRemoved(play.now_ns, letter.id))
    assert [one.memory.suspects for one in given if isinstance(one, trials.KeepCourt)] == [()]


def test_a_conviction_is_told_to_whoever_runs_the_server() -> None:
    play = _died("a")
    _filed(play, "a")
    alerts = [one for one in _tried(play, "a", Ordeal.DIED, signal=11) if isinstance(one, orders.Alert)]
    assert [one.diagnosis for one in alerts] == [Diagnosis.CRASHED]


def test_who_sends_it_again_is_told_again_and_nobody_is_alarmed_twice() -> None:
    play = _died("a")
    _filed(play, "a")
    _tried(play, "a", Ordeal.DIED, signal=11)
    assert kinds(_filed(play, "a")) == ["SetAside"]


def test_a_court_that_makes_a_large_copy_is_not_ended() -> None:
    play = _died("a")
    _filed(play, "a")
    play.now_ns += 179 * S
    assert play.tell(trials.CourtAtWork(play.now_ns)) == []
    play.manager.handle_deadline(play.now_ns + 30 * S)
    assert "EndTrials" not in kinds(list(play.manager.take_actions()))
    play.manager.handle_deadline(play.now_ns + 40 * S)
    assert "EndTrials" in kinds(list(play.manager.take_actions()))


def test_a_drill_counts_on_no_budget_and_alarms_nobody() -> None:
    play = Play().begin().running(4)
    note = CommandNote(SlotStage.DECIDING, "c", "k", "drill", "", ("system:drill",), 1)
    play.tell(seen.DrillStarted(play.now_ns, "poison", play.life))
    play.die(SEGV, a_page(4, note, seq=9))
    play.ready(5)
    _filed(play, "k")
    given = _tried(play, "k", Ordeal.DIED, signal=11)
    assert kinds(given)[0] == "SetAside"
    assert not {"Alert", "KeepBudget"} & set(kinds(play.ordered))
