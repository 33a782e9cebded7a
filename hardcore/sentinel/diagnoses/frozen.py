"""FROZEN: the process is stopped, by nobody of ours, and the beats with it.

A stop of a moment heals: both the letter T and the silence must have lasted, each by itself.
"""

from hardcore.model.verdicts import Diagnosis, Grade, Verdict
from hardcore.sentinel.look import Look, lasted, red
from hardcore.sentinel.patience import Patience


def judge(look: Look, patience: Patience) -> Verdict | None:
    """Return FROZEN, certain, or None."""
    limit_ms = patience.conclusive_ms
    if look.process.stopped and lasted(look.process.stopped_ns, limit_ms) and look.ages.loop_stale(limit_ms):
        return red(Diagnosis.FROZEN, Grade.CERTAIN, look.ages.last_loop_ns)
    return None
