from hardcore.model import verdicts
from hardcore.model.observations import Exit
from hardcore.model.recorder import Beats, CommandNote, LastWords, Page, SlotStage, Threads, Witness
from hardcore.model.verdicts import Colour, Diagnosis, Grade
from hardcore.recovery.story import DEATHS_MAX, EVIDENCE_MAX, Story


def _story() -> Story:
    return Story("i", 100, Diagnosis.CRASHED, Grade.CERTAIN, life=1, epoch=4)


def _page(*notes: CommandNote, words: str = "", seq: int = 0) -> Page:
    said = LastWords(1, words, "") if words else None
    witness = Witness(seq, 4, "h") if seq else None
    return Page("n", "b", 1, 1, Threads(), Beats(), witness, said, notes, (), ())


def _note(number: int, stage: SlotStage = SlotStage.DECIDING) -> CommandNote:
    return CommandNote(stage, f"c{number}", f"k{number}", "transaction", "", (), 1)


def test_when_it_began_is_told_by_the_first_moment() -> None:
    story = _story()
    for at_ns in (5, 9):
        for name in ("fault", "detected", "alerted", "frozen", "dumped", "killed"):
            story.mark(name, at_ns)
    assert set(story.steps.values()) == {5}


def test_when_it_was_over_is_told_by_the_last_try() -> None:
    story = _story()
    for at_ns in (5, 9):
        for name in ("spawned", "fenced", "ready", "verified", "serving"):
            story.mark(name, at_ns)
    assert set(story.steps.values()) == {9}


def test_a_second_page_adds_what_the_first_did_not_know() -> None:
    story = _story()
    story.add_page(_page(_note(1)), Diagnosis.CRASHED)
    story.add_page(_page(_note(1), _note(2)), Diagnosis.CRASHED)
    assert [note.command_id for note in story.in_flight] == ["c1", "c2"]
    assert story.suspects == ("k1", "k2")


def test_the_first_last_words_are_kept_and_the_newest_witness() -> None:
    story = _story()
    story.add_page(_page(words="FIRST", seq=3), Diagnosis.CRASHED)
    story.add_page(_page(words="SECOND", seq=5), Diagnosis.CRASHED)
    story.add_page(_page(), Diagnosis.CRASHED)
    assert story.last_words is not None
    assert story.witness is not None
    assert (story.last_words.code, story.witness.seq) == ("FIRST", 5)


def test_who_is_suspect_is_asked_of_the_life_whose_page_it_is() -> None:
    story = _story()
    story.add_page(_page(_note(1)), Diagnosis.KILLED_FROM_OUTSIDE)
    story.add_page(_page(_note(2)), Diagnosis.LOOP_BLOCKED)
    assert story.suspects == ("k2",)


def test_a_page_that_nobody_could_read_changes_nothing() -> None:
    story = _story()
    story.add_page(None, Diagnosis.CRASHED)
    assert story == _story()


def test_no_list_grows_without_bound() -> None:
    story = _story()
    for n in range(2 * max(DEATHS_MAX, EVIDENCE_MAX)):
        story.add_death(Diagnosis.CRASHED, Exit(signal=11), n)
        story.add_evidence((verdicts.Testimony("w", Colour.RED, str(n)),))
    assert len(story.deaths) == DEATHS_MAX
    assert len(story.evidence) == EVIDENCE_MAX


def test_the_same_evidence_is_told_once() -> None:
    story = _story()
    fact = verdicts.Testimony("pidfd", Colour.RED, "gone")
    story.add_evidence((fact, fact))
    story.add_evidence((fact,))
    assert story.evidence == [fact]


def test_the_timeline_is_told_in_the_order_of_time() -> None:
    story = _story()
    story.mark("spawned", 30)
    story.mark("fault", 10)
    story.mark("detected", 20)
    told = story.told("recovered", 40)
    assert told.timeline == (("fault", 10), ("detected", 20), ("spawned", 30), ("closed", 40))
    assert (told.outcome, told.closed_ns) == ("recovered", 40)
