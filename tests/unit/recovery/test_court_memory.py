"""What is remembered of suspects and trials, for how long, and by whom."""

from hardcore.model import trials
from hardcore.model.trials import Acquit, CourtMemory, Ordeal, SetAside, StopSource, Try
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.court import (
    GATHER_NS,
    PATIENCE_NS,
)
from hardcore.recovery.register import REMEMBERED_NS, SUSPECTS_MAX, Death, Register
from tests.unit.recovery.bench import SEGV, Bench, S, letter_of


def test_too_many_convictions_stop_their_source_and_nobody_else() -> None:
    bench = Bench()
    given: list[trials.TrialAction] = []
    for n in range(3):
        bench.on_trial(f"p{n}", "x")
        given += bench.tried(f"p{n}", Ordeal.DIED, signal=SEGV)
        bench.tried("x", Ordeal.SURVIVED)
        bench.over()
    assert [one for one in given if isinstance(one, StopSource)] == [StopSource("browser:1", 600 * S)]


def test_an_address_is_never_said_to_be_stopped() -> None:
    bench = Bench()
    for n in range(4):
        bench.accuse(f"p{n}")
        bench.file(f"p{n}", source="peer:127.0.0.1")
        given = bench.tried(f"p{n}", Ordeal.DIED, signal=SEGV)
        assert letter_of(given).name == f"p{n}", "it is convicted like any other"
        assert not [one for one in given if isinstance(one, StopSource)]
        bench.over()


def test_convictions_far_apart_stop_no_source() -> None:
    bench = Bench()
    for n in range(5):
        bench.now_ns += 60 * S
        bench.on_trial(f"p{n}")
        assert not [x for x in bench.tried(f"p{n}", Ordeal.DIED, signal=SEGV) if isinstance(x, StopSource)]
        bench.over()


def test_a_case_that_comes_again_is_told_the_same() -> None:
    bench = Bench().on_trial("a")
    letter = letter_of(bench.tried("a", Ordeal.DIED, signal=SEGV))
    assert bench.file("a") == [SetAside(letter, again=True)]


def test_a_rule_that_is_removed_is_forgotten_with_its_deaths() -> None:
    bench = Bench().on_trial("a")
    letter = letter_of(bench.tried("a", Ordeal.DIED, signal=SEGV))
    bench.court.register.release(letter.id)
    bench.over()
    bench.accuse("a")
    assert bench.court.register.by_key["a"].deaths == 1


def test_a_successor_goes_on_where_the_court_was() -> None:
    bench = Bench().on_trial("a", "b")
    bench.tried("a", Ordeal.DIED, signal=SEGV)
    kept = [one for one in bench.court.kept() if isinstance(one, trials.KeepCourt)][-1]
    heir = Bench()
    heir.now_ns = bench.now_ns
    heir.court.inherit(kept.memory, ("c",), bench.now_ns)
    assert [one.name for one in heir.court.register.suspected()] == ["b", "c"]
    assert [one.names for one in heir.sit(GATHER_NS) if isinstance(one, Try)] == [("b",)]


def test_who_was_cleared_and_at_work_again_when_the_guard_died_is_suspect_again() -> None:
    cleared = trials.Suspect("a", "i1", ordeal=Ordeal.SURVIVED)
    register = Register()
    register.inherit(CourtMemory((cleared,)), ["a"], 5 * S)
    assert [one.name for one in register.suspected()] == ["a"]


def test_a_stamp_of_another_boot_counts_as_fresh() -> None:
    register = Register()
    register.inherit(CourtMemory((trials.Suspect("a", "i1", at_ns=900 * S),)), [], 5 * S)
    assert register.by_key["a"].at_ns == 5 * S


def test_what_is_over_is_forgotten_after_a_day_and_the_list_is_bounded() -> None:
    bench = Bench().on_trial("a")
    bench.tried("a", Ordeal.SURVIVED)
    bench.over()
    bench.now_ns += REMEMBERED_NS
    bench.accuse("b")
    bench.accuse("c")
    assert set(bench.court.register.by_key) == {"b", "c"}
    bench.accuse(*(f"n{n}" for n in range(SUSPECTS_MAX)))
    assert len(bench.court.register.by_key) == SUSPECTS_MAX


def test_an_incident_is_told_when_all_its_trials_are_over() -> None:
    bench = Bench().on_trial("a", "b")
    bench.tried("a", Ordeal.SURVIVED)
    assert not [one for one in bench.court.kept() if isinstance(one, trials.AddTrials)]
    bench.tried("b", Ordeal.DIED, signal=SEGV)
    told = [one for one in bench.court.kept() if isinstance(one, trials.AddTrials)]
    assert [(one.incident, [note.ordeal for note in one.trials]) for one in told] == [
        ("i101", [Ordeal.SURVIVED, Ordeal.DIED])
    ]
    assert bench.court.kept() == []


def _find(bench: Bench, seq: int) -> trials.Letter:
    """A core died before it served, and this event of the log does it again."""
    bench.now_ns += S
    death = Death(bench.now_ns, f"i{bench.now_ns // S}", Diagnosis.CRASHED)
    bench.court.suspect_log(death, 0, bench.now_ns)
    bench.sit()
    letter = letter_of(bench.tried("", Ordeal.DIED, signal=SEGV, seq=seq))
    bench.over()
    return letter


def test_an_event_whose_rule_was_taken_away_long_after_its_letter_was_forgotten_is_parked_again() -> None:
    bench = Bench()
    first = _find(bench, 77)
    heir = Bench()
    heir.court.inherit(CourtMemory(), (), heir.now_ns)  # a day has passed: what is over is not remembered
    heir.court.register.release(first.id)
    assert _find(heir, 77).seq == 77


def test_an_event_that_is_found_again_because_its_rule_was_lost_has_one_letter() -> None:
    bench = Bench()
    first = _find(bench, 77)
    again = _find(bench, 77)
    assert (again.id, again.deaths, again.incidents) == (first.id, 2, (*first.incidents, "i102"))


def test_convictions_of_another_boot_stop_no_source() -> None:
    bench = Bench()
    old = tuple(trials.Conviction("browser:1", 900 * S + n) for n in range(10))
    bench.court.inherit(CourtMemory(convictions=old), (), bench.now_ns)
    bench.on_trial("a")
    assert not [x for x in bench.tried("a", Ordeal.DIED, signal=SEGV) if isinstance(x, StopSource)]


def test_deaths_of_another_boot_stay_deaths_of_their_own() -> None:
    register = Register()
    told = (
        trials.Suspect("a", "i1", at_ns=800 * S),
        trials.Suspect("b", "i2", at_ns=900 * S, filed_ns=901 * S),
    )
    register.inherit(CourtMemory(told), [], 5 * S)
    assert [one.at_ns for one in register] == [-96 * S, 4 * S]
    assert register.by_key["b"].filed_ns == 5 * S


def test_who_is_not_heard_of_for_a_day_is_suspect_no_longer() -> None:
    bench = Bench()
    bench.accuse("a")
    assert bench.sit(PATIENCE_NS) == []
    due_ns = bench.court.next_ns()
    assert due_ns is not None
    assert bench.sit(due_ns - bench.now_ns) == [Acquit("a", run=False)]
    assert (bench.court.register.by_key, bench.court.next_ns()) == ({}, None)


def test_where_there_are_too_many_a_letter_is_remembered_longer_than_who_never_came() -> None:
    bench = Bench().on_trial("a")
    letter = letter_of(bench.tried("a", Ordeal.DIED, signal=SEGV))
    bench.over()
    bench.accuse("gone")
    bench.sit(PATIENCE_NS)
    bench.accuse(*(f"n{n}" for n in range(SUSPECTS_MAX - 1)))
    assert "gone" not in bench.court.register.by_key
    assert bench.court.register.by_key["a"].letter == letter.id
