"""COMPONENT_STALLED: one part of the core stands still while the core itself goes on.

Its own beat says so, and the core's two beats and its process say that it is no matter of the whole: where those are
late, or the machine gives nobody its time, another diagnosis speaks, or nobody.
"""

from msgspec import structs

from hardcore.model.verdicts import Diagnosis, Grade, Verdict
from hardcore.sentinel.look import Look, ms, red
from hardcore.sentinel.patience import Patience


def judge(look: Look, patience: Patience) -> Verdict | None:
    """Return COMPONENT_STALLED or None."""
    found = look.stalled
    late = look.ages.loop_stale(patience.late_ms) or look.ages.thread_stale(patience.late_ms)
    if found is None or late or look.process.stopped or look.late_often:
        return None
    fact = (
        f"the part {found.name} has been silent for {ms(found.for_ns)} ms while the loop and its thread beat"
    )
    said = red(Diagnosis.COMPONENT_STALLED, Grade.CERTAIN, found.since_ns, fact)
    return structs.replace(said, component=found.name)
