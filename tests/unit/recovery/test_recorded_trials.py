"""What the court heard and ordered can be written into a recording and read again."""

from typing import get_args

import pytest

from hardcore.model import trials
from hardcore.model.trials import CourtMemory, Letter, Ordeal, Reason, Suspect, SuspectNote, TrialNote
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.court import Court, Rules
from hardcore.recovery.flight import CODEC

LETTER = Letter("l1", "a", Reason.CRASHED_CORE, False, ("i1",), 1, account_ids=("assets:cash",), seq=7)
MEMORY = CourtMemory(
    (Suspect("a", "i1", blame=Diagnosis.CRASHED, ordeal=Ordeal.DIED, letter="l1"),),
    7,
    (trials.Conviction("browser:1", 5),),
)
TOLD = (
    trials.CaseFiled(1, "a", "browser:1", "d"),
    trials.SuspectsSettled(1, ("a", "b")),
    trials.Tried(1, "a", Ordeal.HUNG, 7, account_ids=("assets:cash",), seq=7),
    trials.CourtAtWork(1),
    trials.TrialsOver(1, "no room"),
    trials.RuleRemoved(1, "l1"),
    trials.Try(("a",), 15_000, 1 << 29),
    trials.TryLog(3, 15_000, 1 << 29),
    trials.EndTrials(),
    trials.SetAside(LETTER),
    trials.Acquit("a", run=True),
    trials.StopSource("browser:1", 600),
    trials.KeepCourt((SuspectNote("a", ("assets:cash",)),), MEMORY),
    trials.AddTrials("i1", (TrialNote("a", "c", Ordeal.DIED, "l1", 7),)),
)


@pytest.mark.parametrize("told", TOLD, ids=lambda told: type(told).__name__)
def test_it_comes_back_as_it_was(told: object) -> None:
    assert CODEC.decode(CODEC.encode(told)) == told


def test_nothing_is_forgotten_here() -> None:
    known = set(get_args(trials.TrialObservation)) | set(get_args(trials.TrialAction))
    assert {type(told) for told in TOLD} == known


def test_a_court_in_session_comes_back_as_it_was() -> None:
    court = Court(Rules(1, 2, 3, 4, 5, 6))
    court.inherit(MEMORY, ("b",), 9)
    court.filed("b", "browser:1", "d", 9)
    court.served_ns = 9
    assert court.convene(9, lambda: "l2")
    assert CODEC.decode(CODEC.encode(court)) == court
