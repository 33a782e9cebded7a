"""Who may have caused a death: the suspects.

A command is a suspect only if the death can have come from inside (a fatal signal of its own, an unasked
exit, a hang whose frame is named, memory that grew during it) and the command was being decided or written. Random
kills from outside convicted 79 innocents in 150 deaths without this rule. Until trials exist, a suspect is never
replayed: it is looked up after the fence and its sender is told what became of it.
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


def suspects(
    diagnosis: Diagnosis, in_flight: Iterable[CommandNote], growth: Growth | None = None
) -> tuple[str, ...]:
    """Return the key hashes of the commands that must not be replayed after this death.

    `growth`: how the dead core's memory went, if anybody looked.
    """
    touched = [note for note in in_flight if note.key_hash and note.stage in _TOUCHED]
    if diagnosis is Diagnosis.OUT_OF_MEMORY:
        return tuple(note.key_hash for note in touched if growth is not None and growth.grew(note))
    return tuple(note.key_hash for note in touched) if diagnosis in FROM_INSIDE else ()
