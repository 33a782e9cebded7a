"""Who is tried, and what a trial means."""

import pytest
from msgspec import structs

from hardcore import sitting
from hardcore.model import trials
from hardcore.model.trials import Acquit, EndTrials, Ordeal, Reason, SetAside, Try
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.court import (
    COPY_NS,
    ENDING_NS,
    GATHER_NS,
    PATIENCE_NS,
)
from hardcore.recovery.register import Death
from tests.unit.recovery.bench import KILL, ONE_TRIAL, SEGV, Bench, S, acquitted, fail, letter_of


def test_a_death_alone_convicts_nobody() -> None:
    bench = Bench()
    bench.accuse("a")
    assert not [one for one in bench.sit() if isinstance(one, SetAside)]


def test_whoever_does_it_again_is_set_aside() -> None:
    letter = letter_of(Bench().on_trial("a").tried("a", Ordeal.DIED, signal=SEGV))
    assert (letter.name, letter.reason, letter.held) == ("a", Reason.CRASHED_CORE, False)
    assert (letter.source, letter.digest, letter.fingerprint, letter.incidents) == (
        "browser:1",
        "d-a",
        "f",
        ("i101",),
    )


@pytest.mark.parametrize(("signal", "code"), [(KILL, None), (15, None), (None, 73), (None, 74), (None, None)])
def test_a_core_on_trial_that_was_ended_from_outside_convicts_nobody(
    signal: int | None, code: int | None
) -> None:
    bench = Bench().on_trial("a")
    assert bench.tried("a", Ordeal.DIED, signal=signal, code=code) == []
    assert any(isinstance(one, Try) for one in bench.over()), "it is tried once more"


@pytest.mark.parametrize("code", [0, 1, 70])
def test_a_core_on_trial_that_leaves_unasked_convicts(code: int) -> None:
    assert not letter_of(Bench().on_trial("a").tried("a", Ordeal.DIED, code=code)).held


def test_who_survives_is_run() -> None:
    assert acquitted(Bench().on_trial("a").tried("a", Ordeal.SURVIVED)) == ["a"]


def test_what_the_copy_has_committed_is_answered_by_the_core_that_has_its_key() -> None:
    assert acquitted(Bench().on_trial("a").tried("a", Ordeal.COMMITTED)) == ["a"]


def test_slow_once_is_not_guilty_and_slow_twice_is() -> None:
    bench = Bench().on_trial("a")
    assert bench.tried("a", Ordeal.HUNG) == []
    assert any(isinstance(one, Try) for one in bench.over())
    assert letter_of(bench.tried("a", Ordeal.HUNG)).reason is Reason.HUNG_CORE


@pytest.mark.parametrize(
    ("ordeal", "blame", "reason"),
    [
        (Ordeal.GREW, Diagnosis.OUT_OF_MEMORY, Reason.MEMORY_LIMIT),
        (Ordeal.HUNG, Diagnosis.DEADLOCK, Reason.DEADLOCK),
        (Ordeal.HUNG, Diagnosis.SPINNING, Reason.HUNG_CORE),
    ],
)
def test_the_reason_says_what_was_seen(ordeal: Ordeal, blame: Diagnosis, reason: Reason) -> None:
    bench = Bench()
    bench.accuse("a", blame=blame)
    bench.file("a")
    given = bench.tried("a", ordeal)
    if ordeal is Ordeal.HUNG:
        bench.over()
        given = bench.tried("a", ordeal)
    assert letter_of(given).reason is reason


def test_a_second_death_that_no_trial_explains_is_left_to_a_person() -> None:
    bench = Bench().on_trial("a")
    bench.tried("a", Ordeal.SURVIVED)
    bench.over()
    bench.on_trial("a")
    letter = letter_of(bench.tried("a", Ordeal.SURVIVED))
    assert (letter.held, letter.reason, letter.deaths) == (True, Reason.UNPROVEN, 2)
    assert letter.incidents == ("i101", "i102")


def test_bad_company_twice_is_no_second_death() -> None:
    bench = Bench()
    for poison in ("p1", "p2"):
        bench.on_trial("a", poison)
        assert bench.tried("a", Ordeal.SURVIVED) in ([], [Acquit("a", run=True)])
        bench.tried(poison, Ordeal.DIED, signal=SEGV)
        given = bench.over()
        assert not [one for one in given if isinstance(one, SetAside)]
    assert bench.court.register.by_key["a"].ordeal is Ordeal.SURVIVED


def test_who_decided_is_tried_before_company() -> None:
    bench = Bench()
    bench.accuse("a", company=("b", "c"))
    given = bench.file("b", "c", "a")
    assert [one.names for one in given if isinstance(one, Try)] == [("a", "b", "c")]


def test_company_of_a_poison_is_tried_and_convicted_too() -> None:
    bench = Bench()
    bench.accuse("a", company=("b", "c"))
    bench.file("a", "b", "c")
    bench.tried("a", Ordeal.DIED, signal=SEGV)
    assert not letter_of(bench.tried("b", Ordeal.DIED, signal=SEGV)).held
    assert acquitted(bench.tried("c", Ordeal.SURVIVED)) == ["c"]


def test_company_of_an_innocent_is_run_without_a_trial() -> None:
    bench = Bench()
    bench.accuse("a", company=("b",))
    bench.file("a", "b")
    given = bench.tried("a", Ordeal.SURVIVED)
    assert acquitted(given) == ["a", "b"]
    assert EndTrials() in given


@pytest.mark.parametrize("how", ["untried", "over", "late"])
def test_company_never_waits_for_a_trial_that_can_not_be_had(how: str) -> None:
    bench = Bench()
    bench.accuse("a", company=("b",))
    bench.file("a", "b")
    match how:
        case "untried":
            given = bench.tried("b", Ordeal.UNTRIED)
        case "over":
            given = bench.over("no room for a copy")
        case _:
            given = bench.sit(PATIENCE_NS)
    assert "b" in acquitted(given)


@pytest.mark.parametrize("how", ["no room for a copy", "untried", "killed", "silent"])
def test_of_one_death_nobody_is_held_because_no_trial_could_be_held(how: str) -> None:
    bench = Bench().on_trial("a", "b")
    fail(bench, how)
    assert acquitted(fail(bench, how)) == ["a", "b"]
    assert not [one for one in bench.court.register if one.letter]


def test_after_a_second_death_whoever_nobody_could_try_is_left_to_a_person() -> None:
    bench = Bench().on_trial("a")
    for _ in range(2):
        fail(bench, "no room for a copy")
    bench.on_trial("a")
    assert any(isinstance(one, Try) for one in fail(bench, "no room for a copy"))
    letter = letter_of(fail(bench, "no room for a copy"))
    assert (letter.held, letter.deaths) == (True, 2)
    assert bench.court.register.notes("i102")[0].why == "no room for a copy"


def test_a_court_that_says_nothing_is_ended_and_another_is_held() -> None:
    bench = Bench().on_trial("a")
    assert bench.sit(COPY_NS) == [], "a large copy takes its time"
    assert bench.sit(36 * S) == [EndTrials()]
    assert bench.sit() == [], "not before it is gone"
    assert [type(one) for one in bench.sit(ENDING_NS)] == [Try]


def test_cases_of_one_death_share_a_court() -> None:
    bench = Bench()
    bench.accuse("a", "b")
    assert bench.file("a") == []
    assert [one.names for one in bench.file("b") if isinstance(one, Try)] == [("a", "b")]


def test_a_case_that_does_not_come_holds_nobody_up() -> None:
    bench = Bench()
    bench.accuse("a", "b")
    bench.file("a")
    assert bench.court.next_ns() == bench.now_ns + GATHER_NS
    assert [one.names for one in bench.sit(GATHER_NS) if isinstance(one, Try)] == [("a",)]
    assert bench.court.register.suspected()[1].account_ids == ("assets:cash",)
    bench.sit(PATIENCE_NS)
    assert bench.court.register.suspected()[1] == trials.SuspectNote("b", ()), "suspect, and no account waits"


def test_nobody_is_tried_while_no_core_serves() -> None:
    bench = Bench()
    bench.accuse("a")
    bench.court.served_ns = None
    assert bench.file("a") == []
    assert bench.court.next_ns() is None


def test_more_suspects_of_one_death_than_are_tried_are_run() -> None:
    bench = Bench(ONE_TRIAL).on_trial("a", "b", "c")
    assert acquitted(bench.tried("a", Ordeal.SURVIVED) + bench.over()) == ["a", "b", "c"]


def test_more_suspects_of_two_deaths_than_are_tried_are_left_to_a_person_unless_the_death_is_explained() -> (
    None
):
    for ordeal, run, held in ((Ordeal.SURVIVED, [], ["a", "b"]), (Ordeal.DIED, ["a"], ["b"])):
        bench = Bench(ONE_TRIAL).on_trial("a", "b")
        bench.tried("a", Ordeal.SURVIVED)
        bench.over()
        bench.on_trial("a", "b")
        given = bench.tried("b", ordeal, signal=SEGV) + bench.over()
        assert acquitted(given) == run
        assert sorted(one.letter.name for one in given if isinstance(one, SetAside)) == held


def test_after_a_second_death_those_are_tried_first_who_have_not_been() -> None:
    bench = Bench(ONE_TRIAL).on_trial("a", "b")
    bench.tried("a", Ordeal.SURVIVED)
    bench.over()
    bench.accuse("a", "b")
    assert [one.names for one in bench.file("a", "b") if isinstance(one, Try)] == [("b",)]


def test_each_death_has_trials_of_its_own() -> None:
    bench = Bench(ONE_TRIAL)
    for name in ("a", "b"):
        bench.accuse(name)
        bench.court.register.put(structs.replace(bench.court.register.by_key[name], incident="one"))
        assert any(isinstance(one, Try) for one in bench.file(name))
        bench.tried(name, Ordeal.SURVIVED)
        bench.over()


def test_a_case_of_nobody_suspect_is_answered_at_once() -> None:
    bench = Bench()
    assert acquitted(bench.file("stranger")) == ["stranger"]


def test_who_is_in_the_ledger_leaves_the_court() -> None:
    bench = Bench()
    bench.accuse("a")
    bench.court.register.settle(["a"])
    assert bench.court.register.suspected() == ()


def test_a_core_that_dies_without_them_clears_the_suspects() -> None:
    bench = Bench().on_trial("a")
    assert acquitted(bench.court.clear(bench.now_ns)) == ["a"]
    assert bench.court.register.by_key["a"].deaths == 0


def test_the_log_is_tried_before_anybody_else() -> None:
    bench = Bench().on_trial("a")
    death = Death(bench.now_ns, "i9", Diagnosis.CRASHED)
    assert bench.court.suspect_log(death, 3, bench.now_ns) == [EndTrials()]
    assert [type(one) for one in bench.over()] == [trials.TryLog]
    letter = letter_of(bench.tried("", Ordeal.DIED, signal=SEGV, seq=812))
    assert (letter.seq, letter.held) == (812, False)
    assert [type(one) for one in bench.over()] == [Try], "then the court goes on"


def test_a_court_that_says_how_far_it_is_is_not_silent() -> None:
    bench = Bench().on_trial("a")
    bench.sit(COPY_NS)
    bench.court.at_work(bench.now_ns)
    assert bench.sit(34 * S) == []
    assert bench.sit(2 * S) == [EndTrials()]


def test_a_court_is_given_up_no_sooner_than_by_whoever_listens_to_it() -> None:
    assert sitting.COPY_S * S == COPY_NS


def test_a_search_in_the_log_may_read_all_of_it_between_two_words() -> None:
    bench = Bench()
    bench.court.suspect_log(Death(bench.now_ns, "i1", Diagnosis.CRASHED), 0, bench.now_ns)
    assert [type(one) for one in bench.sit()] == [trials.TryLog]
    bench.court.at_work(bench.now_ns)
    assert bench.sit(COPY_NS) == []


def _second_death(bench: Bench) -> None:
    """Somebody who did no harm on trial after one death is at work in another one, with b."""
    bench.on_trial("a")
    bench.tried("a", Ordeal.SURVIVED)
    bench.over()
    bench.accuse("a", "b")
    bench.file("a")
    bench.sit(GATHER_NS)
    assert bench.tried("a", Ordeal.SURVIVED) == []


def test_who_survives_after_two_deaths_is_judged_when_a_case_of_the_same_death_that_comes_late_was_tried() -> (
    None
):
    bench = Bench()
    _second_death(bench)
    assert bench.over() == []
    assert [one.names for one in bench.file("b") if isinstance(one, Try)] == [("b",)], "a is not tried again"
    given = bench.tried("b", Ordeal.DIED, signal=SEGV)
    assert letter_of(given).name == "b"
    assert acquitted(given) == ["a"]


def test_who_survives_after_two_deaths_waits_for_a_case_that_does_not_come_as_long_as_anybody() -> None:
    bench = Bench()
    _second_death(bench)
    bench.over()
    assert bench.sit(PATIENCE_NS // 2) == []
    assert letter_of(bench.sit(PATIENCE_NS // 2)).name == "a"
