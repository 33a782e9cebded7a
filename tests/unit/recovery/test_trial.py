import pytest

from hardcore.model.recorder import CommandNote, SlotStage
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.suspicion import GREW_BYTES, Growth
from hardcore.recovery.trial import FROM_INSIDE, company, touched


def suspects(diagnosis: Diagnosis, notes: list[CommandNote], growth: Growth | None = None) -> tuple[str, ...]:
    return tuple(note.key_hash for note in touched(diagnosis, notes, growth))


def _note(stage: SlotStage, key: str = "k") -> CommandNote:
    return CommandNote(stage, f"c-{key}", key, "transaction", "t", (), 1)


@pytest.mark.parametrize("stage", SlotStage)
def test_only_what_was_being_decided_or_written_is_suspect(stage: SlotStage) -> None:
    touched = stage in {SlotStage.DECIDING, SlotStage.WRITING}
    assert suspects(Diagnosis.CRASHED, [_note(stage)]) == (("k",) if touched else ())


@pytest.mark.parametrize("diagnosis", sorted(set(Diagnosis) - FROM_INSIDE))
def test_nobody_is_suspect_of_a_death_that_came_from_outside(diagnosis: Diagnosis) -> None:
    assert suspects(diagnosis, [_note(SlotStage.DECIDING)]) == ()


@pytest.mark.parametrize(
    "diagnosis",
    [
        Diagnosis.KILLED_FROM_OUTSIDE,
        Diagnosis.FROZEN,
        Diagnosis.NO_PROGRESS,
        Diagnosis.FENCED,
        Diagnosis.DISK_FULL,
        Diagnosis.OPERATOR,
        Diagnosis.SENTINEL_LOST,
    ],
)
def test_a_death_is_not_called_from_inside_without_a_cause_in_there(diagnosis: Diagnosis) -> None:
    assert diagnosis not in FROM_INSIDE


def test_a_command_without_a_key_can_not_be_named() -> None:
    assert suspects(Diagnosis.CRASHED, [_note(SlotStage.DECIDING, "")]) == ()


def test_the_whole_batch_is_suspect() -> None:
    batch = [_note(SlotStage.WRITING, "a"), _note(SlotStage.WRITING, "b"), _note(SlotStage.QUEUED, "c")]
    assert suspects(Diagnosis.LOOP_BLOCKED, batch) == ("a", "b")


def test_a_death_for_memory_has_a_suspect_only_if_the_core_grew_during_the_command() -> None:
    note = _note(SlotStage.DECIDING)
    grown, large = Growth(), Growth()
    for at_ns, share in ((0, 1), (2, 2)):
        grown.look(at_ns, share * GREW_BYTES)
        large.look(at_ns, 2 * GREW_BYTES)
    assert suspects(Diagnosis.OUT_OF_MEMORY, [note], grown) == ("k",)
    assert suspects(Diagnosis.OUT_OF_MEMORY, [note], large) == ()
    assert suspects(Diagnosis.OUT_OF_MEMORY, [_note(SlotStage.QUEUED)], grown) == ()


def test_who_was_being_decided_is_tried_before_the_rest_of_the_batch() -> None:
    batch = [_note(SlotStage.WRITING, "a"), _note(SlotStage.DECIDING, "b")]
    assert suspects(Diagnosis.CRASHED, batch) == ("b", "a")


def test_who_stood_behind_a_suspect_of_the_same_kind_is_its_company() -> None:
    decided, queued = _note(SlotStage.DECIDING, "a"), _note(SlotStage.QUEUED, "b")
    other = CommandNote(SlotStage.QUEUED, "c-c", "c", "account", "t", (), 1)
    nameless = _note(SlotStage.QUEUED, "")
    assert company([decided], [decided, queued, other, nameless]) == (queued,)
    assert company([_note(SlotStage.WRITING, "a")], [queued]) == ()
