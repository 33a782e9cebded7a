from msgspec.structs import replace

from hardcore.model.recorder import Beats, CommandNote, SlotStage
from hardcore.model.verdicts import Colour
from hardcore.sentinel.witnesses import progress as witness
from hardcore.sentinel.witnesses.progress import Progress, Stuck
from tests.unit.sentinel.traces import BEGAN_MS, MS, queued, seen

WAITING = Beats(submitted=3, completed=1)


def _look(
    progress: Progress, at_ms: int, beats: Beats, notes: tuple[CommandNote, ...] | None, since_ms: int = 0
) -> Stuck | None:
    return progress.look(beats, notes, seen(BEGAN_MS + at_ms, since_ms=since_ms))


def _begun() -> Progress:
    progress = Progress()
    _look(progress, 0, WAITING, None)
    return progress


def test_what_waits_is_stuck_since_it_waits() -> None:
    stuck = _look(_begun(), 900, WAITING, queued(300, 500))
    assert stuck == Stuck(2, 600 * MS, (BEGAN_MS + 300) * MS)


def test_anything_completed_begins_the_wait_anew() -> None:
    progress = _begun()
    assert _look(progress, 500, replace(WAITING, completed=2), queued(0)) is None
    stuck = _look(progress, 900, replace(WAITING, completed=2), queued(0))
    assert stuck is not None
    assert stuck.for_ns == 400 * MS


def test_silence_before_the_amnesty_does_not_count() -> None:
    stuck = _look(_begun(), 900, WAITING, queued(0), since_ms=BEGAN_MS + 800)
    assert stuck is not None
    assert stuck.for_ns == 100 * MS


def test_nothing_that_waits_is_nothing_stuck() -> None:
    assert _look(_begun(), 900, Beats(submitted=1, completed=1), queued(0)) is None


def test_nobody_looked_is_nothing_stuck() -> None:
    assert _look(_begun(), 900, WAITING, None) is None


def test_a_writer_in_the_store_is_not_stuck() -> None:
    assert _look(_begun(), 900, replace(WAITING, in_store_since_ns=7), queued(0)) is None


def test_a_command_that_was_taken_up_is_somebody_elses_matter() -> None:
    for stage in (SlotStage.DECIDING, SlotStage.WRITING, SlotStage.COMMITTED):
        assert _look(_begun(), 900, WAITING, (*queued(0, stage=stage), *queued(0))) is None


def test_an_answer_on_its_way_does_not_hide_who_waits() -> None:
    notes = (*queued(0, stage=SlotStage.ANSWERING), *queued(0))
    assert _look(_begun(), 900, WAITING, notes) is not None


def test_a_slow_read_does_not_hide_a_write_that_waits() -> None:
    notes = (*queued(0, stage=SlotStage.DECIDING, kind="read"), *queued(0))
    assert _look(_begun(), 900, WAITING, notes) is not None


def test_reads_that_wait_are_not_the_writers_fault() -> None:
    assert _look(_begun(), 900, WAITING, queued(0, 0, kind="read.balances")) is None


def test_a_torn_entry_is_no_evidence() -> None:
    torn = tuple(replace(note, torn=True) for note in queued(0))
    assert _look(_begun(), 900, WAITING, torn) is None


def test_it_is_worth_saying_only_after_a_while() -> None:
    assert witness.testify(Stuck(1, 299 * MS, 0), 300).colour is Colour.GREEN
    assert witness.testify(Stuck(1, 300 * MS, 0), 300).colour is Colour.YELLOW
    assert witness.testify(None, 300).colour is Colour.GREEN
