"""What the archive keeps of a letter beside its state: where it was held, and whose number it has."""

from postmortem.dead_letters.life import Trigger
from postmortem.records import letters
from postmortem.records.opening import Records
from postmortem.records.reads import Archive
from postmortem.views import LetterState
from tests.unit.postmortem.test_records import NOW, _take, archive, records

__all__ = ["archive", "records"]


def test_an_undo_brings_a_letter_back_to_where_it_was(records: Records) -> None:
    letter = _take(records, number=1)
    for before in (LetterState.HELD, LetterState.QUARANTINED):
        with records.writing() as connection:
            if before is LetterState.HELD:
                letters.move(connection, letter, Trigger.HOLD, NOW)
            else:
                letters.move(connection, letter, Trigger.CAME_BACK, NOW)
            letters.move(connection, letter, Trigger.DISCARD, NOW)
            letters.move(connection, letter, Trigger.UNDO, NOW)
            assert [row["id"] for row in letters.in_state(connection, before)] == [letter]


def test_the_number_that_a_trial_made_up_is_not_the_letters(records: Records, archive: Archive) -> None:
    made_up = {"ordeal": "died", "transaction_id": "t-on-a-copy"}
    one, other = (
        archive.letter(_take(records, number=number, trial=made_up, transaction_id=told))
        for number, told in ((1, "t-on-a-copy"), (2, "t-in-flight"))
    )
    assert one is not None
    assert other is not None
    assert (one.transaction_id, other.transaction_id) == ("", "t-in-flight")
