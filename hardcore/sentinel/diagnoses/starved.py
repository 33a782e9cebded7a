"""STARVED: the machine does not let the core run, or us. Told, never acted on: a restart would starve as well."""

from hardcore.model.verdicts import Diagnosis, Verdict
from hardcore.sentinel.look import Look, lasted, ms, yellow
from hardcore.sentinel.patience import Patience


def judge(look: Look, patience: Patience) -> Verdict | None:
    """Return STARVED, yellow, or None."""
    if look.late_often:
        return yellow(Diagnosis.STARVED, "our own looks come late again and again")
    starved_ns = look.processor.starved_ns
    if look.ages.loop_stale(patience.late_ms) and lasted(starved_ns, patience.late_ms):
        fact = f"the loop's thread is ready and was not scheduled for {ms(starved_ns)} ms"
        return yellow(Diagnosis.STARVED, fact)
    return None
