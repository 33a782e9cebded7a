"""Who may have caused a death: the suspects, and the company they were in.

A command is a suspect only if the death can have come from inside (a fatal signal of its own, an unasked
exit, a hang whose frame is named, memory that grew during it) and the command was being decided or written. Random
kills from outside convicted 79 innocents in 150 deaths without this rule. Who stood in the queue behind a suspect of
the same kind is its company: nobody blames it, but if the suspect turns out to be a poison, its like are tried before
they are run, so that ten poisons in one batch cost one death.
"""

from collections.abc import Iterable

from hardcore.model.recorder import CommandNote, SlotStage
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.suspicion import Growth

#: Deaths that can have come from inside. FROZEN is not one: a SIGSTOP comes from outside.
FROM_INSIDE = frozenset(
    {
        Diagnosis.CRASHED,
        Diagnosis.EXITED,
        Diagnosis.LOOP_BLOCKED,
        Diagnosis.SPINNING,
        Diagnosis.GIL_HELD,
        Diagnosis.DEADLOCK,
        Diagnosis.TRANSACTION_TIMEOUT,
    }
)

_TOUCHED = frozenset({SlotStage.DECIDING, SlotStage.WRITING})


def touched(
    diagnosis: Diagnosis, in_flight: Iterable[CommandNote], growth: Growth | None = None
) -> tuple[CommandNote, ...]:
    """Return the commands that must not be run again after this death before they were tried, who was decided first.

    `growth`: how the dead core's memory went, if anybody looked.
    """
    notes = [note for note in in_flight if note.key_hash and note.stage in _TOUCHED]
    if diagnosis is Diagnosis.OUT_OF_MEMORY:
        notes = [note for note in notes if growth is not None and growth.grew(note)]
    elif diagnosis not in FROM_INSIDE:
        return ()
    return tuple(sorted(notes, key=lambda note: note.stage))


def company(suspects: Iterable[CommandNote], in_flight: Iterable[CommandNote]) -> tuple[CommandNote, ...]:
    """Return who stood in the queue while one of these suspects of the same kind was being decided."""
    kinds = {note.kind for note in suspects if note.stage is SlotStage.DECIDING}
    return tuple(
        note for note in in_flight if note.key_hash and note.stage is SlotStage.QUEUED and note.kind in kinds
    )
