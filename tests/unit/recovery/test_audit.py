"""What becomes of the serving core's word about the whole ledger."""

import pytest

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from hardcore.model.phases import HAState
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.policy import Policy, Word
from tests.unit.recovery.play import Play, a_page, kinds

FAULT = "event 5 is not what its hash says"


def told(play: Play, fault: str = "") -> list[orders.Action]:
    """The present core says what it found."""
    return play.tell(seen.LedgerAudited(play.now_ns, play.life, None if fault else 7, fault))


def heard(play: Play) -> seen.LedgerAudited | None:
    return play.manager.reading().audit


def test_a_whole_ledger_is_no_worry_and_nothing_is_ordered() -> None:
    play = Play().begin().running()
    assert told(play) == []
    audit = heard(play)
    assert audit is not None
    assert (audit.ok, audit.seq) == (True, 7)
    assert play.manager.reading().state is HAState.OPERATIONAL


def test_a_ledger_that_is_not_whole_is_shown_at_once_and_ends_no_core() -> None:
    play = Play().begin().running()
    assert kinds(told(play, FAULT)) == ["Alert", "TakeEvidence", "SetSafe"]
    assert play.manager.reading().state is HAState.DEGRADED
    assert play.phase == "RUNNING"


def test_a_word_that_comes_during_the_probation_is_part_of_the_incident() -> None:
    play = Play().begin().running()
    play.die()
    play.ready(5)
    assert told(play) == []
    play.ring()
    audit = play.closed().audit
    assert audit is not None
    assert audit.seq == 7


def test_a_word_that_comes_later_is_added_to_the_incident_that_the_core_was_started_for() -> None:
    play = Play().begin().running()
    play.die()
    play.running(5)
    assert play.closed().audit is None
    order = told(play, FAULT)[0]
    assert isinstance(order, orders.AddAudit)
    assert (order.incident, order.audit.fault) == (play.closed().id, FAULT)


def test_what_one_core_found_is_not_said_of_the_next() -> None:
    tells = frozenset({Word.SEND_ALERT, Word.AWAIT_OPERATOR})
    play = Play(Policy(actions={Diagnosis.STORE_CORRUPT: tells})).begin().running()
    told(play, FAULT)
    play.die(page=a_page())
    assert heard(play) is None
    play.ready(5)
    assert heard(play) is None
    play.ring()
    assert play.manager.reading().state is HAState.OPERATIONAL


@pytest.mark.parametrize("life", [0, 2])
def test_another_life_has_no_word_in_it(life: int) -> None:
    play = Play(Policy()).begin().running()
    assert play.tell(seen.LedgerAudited(play.now_ns, life, None, FAULT)) == []
    assert heard(play) is None


def test_a_core_that_is_being_ended_says_nothing_about_the_ledger() -> None:
    play = Play(Policy(spare=False)).begin().running()
    play.ask(seen.Verb.RESTART)
    assert told(play, FAULT) == []
    assert heard(play) is None
