"""What a trial that was held means, and the letter that is written of it.

Whether a core on trial died of its case has to be asked like that of any other death: it may have been killed, or have
met a full disk. Only what it brought upon itself convicts. A letter is made of what is remembered of its suspect and of
nothing else, so that it can be said again in the same words.
"""

from hardcore.model.observations import Exit
from hardcore.model.trials import REPRODUCED, Letter, Ordeal, Reason, Suspect, Tried
from hardcore.model.verdicts import Diagnosis
from hardcore.sentinel.deaths import own_fault


def is_its_own(fact: Tried) -> bool:
    """Whether what was seen on trial was the case's own doing."""
    if fact.ordeal is not Ordeal.DIED:
        return fact.ordeal in REPRODUCED
    return fact.code == 0 or own_fault(Exit(fact.code, fact.signal)) is not None


def reason(one: Suspect) -> Reason:
    """Return why this suspect is set aside, in one word."""
    match one.ordeal:
        case Ordeal.DIED:
            return Reason.CRASHED_CORE
        case Ordeal.HUNG:
            return Reason.DEADLOCK if one.blame is Diagnosis.DEADLOCK else Reason.HUNG_CORE
        case Ordeal.GREW:
            return Reason.MEMORY_LIMIT
        case _:
            return Reason.UNPROVEN


def letter(one: Suspect) -> Letter:
    """Return the letter of a suspect that is set aside."""
    return Letter(
        one.letter,
        one.name,
        reason(one),
        held=one.ordeal not in REPRODUCED,
        incidents=tuple(name for name in (*one.before, one.incident) if name),
        deaths=one.deaths,
        command_id=one.command_id,
        kind=one.kind,
        account_ids=one.account_ids,
        transaction_id=one.transaction_id,
        source=one.source,
        fingerprint=one.fingerprint,
        digest=one.digest,
        seq=one.seq,
    )
