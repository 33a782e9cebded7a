"""Who is tried, what a trial means, and what is remembered of it."""

import dataclasses
from collections.abc import Iterator
from itertools import count

import pytest

from hardcore import sitting
from hardcore.model import trials
from hardcore.model.recorder import CommandNote, SlotStage
from hardcore.model.trials import Acquit, CourtMemory, EndTrials, Ordeal, Reason, SetAside, StopSource, Try
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.court import (
    COPY_NS,
    ENDING_NS,
    GATHER_NS,
    PATIENCE_NS,
    STARTS_OF_A_SEARCH,
    Court,
    Rules,
)
from hardcore.recovery.register import REMEMBERED_NS, SUSPECTS_MAX, Death, Register

S = 1_000_000_000
RULES = Rules(15_000, 1 << 29, 20_000, trial_limit=64, max_convictions=2, source_stop_ns=600 * S)
SEGV = 11
KILL = 9


def _note(name: str, stage: SlotStage = SlotStage.DECIDING) -> CommandNote:
    return CommandNote(stage, f"c-{name}", name, "transaction.post", "t1", ("assets:cash",), 1)


class Bench:
    """A court with a core that serves, and a clock that is moved by hand."""

    def __init__(self, rules: Rules = RULES) -> None:
        self.court = Court(rules, served_ns=100 * S)
        self.now_ns = 100 * S
        self.ids: Iterator[int] = count(1)

    def new_id(self) -> str:
        return f"l{next(self.ids)}"

    def accuse(
        self, *names: str, company: tuple[str, ...] = (), blame: Diagnosis = Diagnosis.CRASHED
    ) -> None:
        """A core died with these at work."""
        self.now_ns += S
        death = Death(self.now_ns, f"i{self.now_ns // S}", blame)
        queued = [_note(name, SlotStage.QUEUED) for name in company]
        self.court.register.accuse(death, [_note(name) for name in names], queued)
        self.court.served_ns = self.now_ns

    def file(self, *names: str, source: str = "browser:1") -> list[trials.TrialAction]:
        given: list[trials.TrialAction] = []
        for name in names:
            given += self.court.filed(name, source, f"d-{name}", self.now_ns)
        return given + self.sit()

    def sit(self, wait_ns: int = 0) -> list[trials.TrialAction]:
        self.now_ns += wait_ns
        return self.court.convene(self.now_ns, self.new_id)

    def tried(
        self,
        name: str,
        ordeal: Ordeal,
        signal: int | None = None,
        code: int | None = None,
        seq: int | None = None,
    ) -> list[trials.TrialAction]:
        fact = trials.Tried(self.now_ns, name, ordeal, 7, fingerprint="f", signal=signal, code=code, seq=seq)
        return self.court.tried(fact, self.new_id) + self.sit()

    def over(self, fault: str = "") -> list[trials.TrialAction]:
        return self.court.over(fault, self.now_ns, self.new_id) + self.sit()

    def on_trial(self, *names: str) -> "Bench":
        self.accuse(*names)
        self.file(*names)
        return self


ONE_TRIAL = Rules(15_000, 1, 20_000, trial_limit=1, max_convictions=9, source_stop_ns=S)


def _fail(bench: Bench, how: str) -> list[trials.TrialAction]:
    """Have a court go wrong that is no suspect's fault."""
    assert bench.court.docket is not None, "it sits"
    names = bench.court.docket.names
    match how:
        case "untried":
            given = [one for name in names for one in bench.tried(name, Ordeal.UNTRIED)]
        case "killed":
            given = [one for name in names for one in bench.tried(name, Ordeal.DIED, signal=KILL)]
        case "silent":
            given = bench.sit(COPY_NS + 36 * S)
            how = "it was ended"
        case _:
            given = []
    return given + bench.over(how)


def _letter(given: list[trials.TrialAction]) -> trials.Letter:
    return next(one.letter for one in given if isinstance(one, SetAside))


def _acquitted(given: list[trials.TrialAction]) -> list[str]:
    return [one.name for one in given if isinstance(one, Acquit) and one.run]


def test_a_death_alone_convicts_nobody() -> None:
    bench = Bench()
    bench.accuse("a")
    assert not [one for one in bench.sit() if isinstance(one, SetAside)]


def test_whoever_does_it_again_is_set_aside() -> None:
    letter = _letter(Bench().on_trial("a").tried("a", Ordeal.DIED, signal=SEGV))
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
    assert not _letter(Bench().on_trial("a").tried("a", Ordeal.DIED, code=code)).held


def test_who_survives_is_run() -> None:
    assert _acquitted(Bench().on_trial("a").tried("a", Ordeal.SURVIVED)) == ["a"]


def test_what_the_copy_has_committed_is_answered_by_the_core_that_has_its_key() -> None:
    assert _acquitted(Bench().on_trial("a").tried("a", Ordeal.COMMITTED)) == ["a"]


def test_slow_once_is_not_guilty_and_slow_twice_is() -> None:
    bench = Bench().on_trial("a")
    assert bench.tried("a", Ordeal.HUNG) == []
    assert any(isinstance(one, Try) for one in bench.over())
    assert _letter(bench.tried("a", Ordeal.HUNG)).reason is Reason.HUNG_CORE


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
    assert _letter(given).reason is reason


def test_a_second_death_that_no_trial_explains_is_left_to_a_person() -> None:
    bench = Bench().on_trial("a")
    bench.tried("a", Ordeal.SURVIVED)
    bench.over()
    bench.on_trial("a")
    letter = _letter(bench.tried("a", Ordeal.SURVIVED))
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
    assert not _letter(bench.tried("b", Ordeal.DIED, signal=SEGV)).held
    assert _acquitted(bench.tried("c", Ordeal.SURVIVED)) == ["c"]


def test_company_of_an_innocent_is_run_without_a_trial() -> None:
    bench = Bench()
    bench.accuse("a", company=("b",))
    bench.file("a", "b")
    given = bench.tried("a", Ordeal.SURVIVED)
    assert _acquitted(given) == ["a", "b"]
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
    assert "b" in _acquitted(given)


@pytest.mark.parametrize("how", ["no room for a copy", "untried", "killed", "silent"])
def test_of_one_death_nobody_is_held_because_no_trial_could_be_held(how: str) -> None:
    bench = Bench().on_trial("a", "b")
    _fail(bench, how)
    assert _acquitted(_fail(bench, how)) == ["a", "b"]
    assert not [one for one in bench.court.register if one.letter]


def test_after_a_second_death_whoever_nobody_could_try_is_left_to_a_person() -> None:
    bench = Bench().on_trial("a")
    for _ in range(2):
        _fail(bench, "no room for a copy")
    bench.on_trial("a")
    assert any(isinstance(one, Try) for one in _fail(bench, "no room for a copy"))
    letter = _letter(_fail(bench, "no room for a copy"))
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
    assert _acquitted(bench.tried("a", Ordeal.SURVIVED) + bench.over()) == ["a", "b", "c"]


def test_more_suspects_of_two_deaths_than_are_tried_are_left_to_a_person_unless_the_death_is_explained() -> (
    None
):
    for ordeal, acquitted, held in ((Ordeal.SURVIVED, [], ["a", "b"]), (Ordeal.DIED, ["a"], ["b"])):
        bench = Bench(ONE_TRIAL).on_trial("a", "b")
        bench.tried("a", Ordeal.SURVIVED)
        bench.over()
        bench.on_trial("a", "b")
        given = bench.tried("b", ordeal, signal=SEGV) + bench.over()
        assert _acquitted(given) == acquitted
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
        bench.court.register.put(dataclasses.replace(bench.court.register.by_key[name], incident="one"))
        assert any(isinstance(one, Try) for one in bench.file(name))
        bench.tried(name, Ordeal.SURVIVED)
        bench.over()


def test_too_many_convictions_stop_their_source_and_nobody_else() -> None:
    bench = Bench()
    given: list[trials.TrialAction] = []
    for n in range(3):
        bench.on_trial(f"p{n}", "x")
        given += bench.tried(f"p{n}", Ordeal.DIED, signal=SEGV)
        bench.tried("x", Ordeal.SURVIVED)
        bench.over()
    assert [one for one in given if isinstance(one, StopSource)] == [StopSource("browser:1", 600 * S)]


def test_convictions_far_apart_stop_no_source() -> None:
    bench = Bench()
    for n in range(5):
        bench.now_ns += 60 * S
        bench.on_trial(f"p{n}")
        assert not [x for x in bench.tried(f"p{n}", Ordeal.DIED, signal=SEGV) if isinstance(x, StopSource)]
        bench.over()


def test_a_case_of_nobody_suspect_is_answered_at_once() -> None:
    bench = Bench()
    assert _acquitted(bench.file("stranger")) == ["stranger"]


def test_a_case_that_comes_again_is_told_the_same() -> None:
    bench = Bench().on_trial("a")
    letter = _letter(bench.tried("a", Ordeal.DIED, signal=SEGV))
    assert bench.file("a") == [SetAside(letter, again=True)]


def test_who_is_in_the_ledger_leaves_the_court() -> None:
    bench = Bench()
    bench.accuse("a")
    bench.court.register.settle(["a"])
    assert bench.court.register.suspected() == ()


def test_a_core_that_dies_without_them_clears_the_suspects() -> None:
    bench = Bench().on_trial("a")
    assert _acquitted(bench.court.clear(bench.now_ns)) == ["a"]
    assert bench.court.register.by_key["a"].deaths == 0


def test_the_log_is_tried_before_anybody_else() -> None:
    bench = Bench().on_trial("a")
    death = Death(bench.now_ns, "i9", Diagnosis.CRASHED)
    assert bench.court.suspect_log(death, 3, bench.now_ns) == [EndTrials()]
    assert [type(one) for one in bench.over()] == [trials.TryLog]
    letter = _letter(bench.tried("", Ordeal.DIED, signal=SEGV, seq=812))
    assert (letter.seq, letter.held) == (812, False)
    assert [type(one) for one in bench.over()] == [Try], "then the court goes on"


def test_a_rule_that_is_removed_is_forgotten_with_its_deaths() -> None:
    bench = Bench().on_trial("a")
    letter = _letter(bench.tried("a", Ordeal.DIED, signal=SEGV))
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


def test_a_court_that_says_how_far_it_is_is_not_silent() -> None:
    bench = Bench().on_trial("a")
    bench.sit(COPY_NS)
    bench.court.at_work(bench.now_ns)
    assert bench.sit(34 * S) == []
    assert bench.sit(2 * S) == [EndTrials()]


def test_a_court_is_given_up_no_sooner_than_by_whoever_listens_to_it() -> None:
    assert sitting.COPY_S * S == COPY_NS
    assert sitting.STARTS_OF_A_SEARCH == STARTS_OF_A_SEARCH


def test_a_search_in_the_log_may_start_many_cores_between_two_words() -> None:
    bench = Bench()
    bench.court.suspect_log(Death(bench.now_ns, "i1", Diagnosis.CRASHED), 0, bench.now_ns)
    assert [type(one) for one in bench.sit()] == [trials.TryLog]
    bench.court.at_work(bench.now_ns)
    assert bench.sit(STARTS_OF_A_SEARCH * 30 * S) == []


def _find(bench: Bench, seq: int) -> trials.Letter:
    """A core died before it served, and this event of the log does it again."""
    bench.now_ns += S
    death = Death(bench.now_ns, f"i{bench.now_ns // S}", Diagnosis.CRASHED)
    bench.court.suspect_log(death, 0, bench.now_ns)
    bench.sit()
    letter = _letter(bench.tried("", Ordeal.DIED, signal=SEGV, seq=seq))
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
    letter = _letter(bench.tried("a", Ordeal.DIED, signal=SEGV))
    bench.over()
    bench.accuse("gone")
    bench.sit(PATIENCE_NS)
    bench.accuse(*(f"n{n}" for n in range(SUSPECTS_MAX - 1)))
    assert "gone" not in bench.court.register.by_key
    assert bench.court.register.by_key["a"].letter == letter.id


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
    assert _letter(given).name == "b"
    assert _acquitted(given) == ["a"]


def test_who_survives_after_two_deaths_waits_for_a_case_that_does_not_come_as_long_as_anybody() -> None:
    bench = Bench()
    _second_death(bench)
    bench.over()
    assert bench.sit(PATIENCE_NS // 2) == []
    assert _letter(bench.sit(PATIENCE_NS // 2)).name == "a"
