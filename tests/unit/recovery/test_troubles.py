from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.troubles import Troubles

LOCKED, CORRUPT = Diagnosis.DB_LOCKED, Diagnosis.STORE_CORRUPT


def test_only_the_first_word_of_a_trouble_is_news() -> None:
    troubles = Troubles(10)
    assert [troubles.meets(LOCKED), troubles.meets(LOCKED), troubles.meets(CORRUPT)] == [True, False, True]


def test_a_trouble_is_over_when_it_has_been_quiet_for_long_enough() -> None:
    troubles = Troubles(10)
    troubles.meets(LOCKED)
    troubles.look(100, quiet=True)
    troubles.look(105, quiet=True)
    assert troubles.due_ns == 110


def test_a_trouble_that_comes_and_goes_is_one() -> None:
    troubles = Troubles(10)
    troubles.meets(LOCKED)
    troubles.look(100, quiet=True)
    troubles.look(105, quiet=False)
    troubles.look(106, quiet=True)
    assert troubles.due_ns == 116
    assert not troubles.meets(LOCKED)


def test_a_damaged_ledger_is_not_whole_because_nobody_speaks_of_it() -> None:
    troubles = Troubles(10)
    troubles.meets(CORRUPT)
    troubles.look(100, quiet=True)
    assert troubles.due_ns is None


def test_where_nothing_is_wrong_nothing_ends() -> None:
    troubles = Troubles(10)
    troubles.look(100, quiet=True)
    assert (troubles.on, troubles.due_ns) == (False, None)
