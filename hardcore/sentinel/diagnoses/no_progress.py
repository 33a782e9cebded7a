"""NO_PROGRESS: the beats go on and nothing comes of it.

Three ways to see it: commands wait for a writer that is asleep or gone; more is answered than is committed; or the
core's own socket does not answer while nothing else moves. Each needs the beats to be fresh, because a loop that
stands still is another matter, and each must have lasted.
"""

from hardcore.model.verdicts import Diagnosis, Grade, Verdict
from hardcore.sentinel.look import Look, lasted, ms, red
from hardcore.sentinel.patience import Patience
from hardcore.sentinel.witnesses.probe import PROBES_MIN
from hardcore.sentinel.witnesses.process_state import Sleep


def judge(look: Look, patience: Patience) -> Verdict | None:
    """Return NO_PROGRESS or None."""
    if look.ages.loop_stale(patience.late_ms):
        return None
    return _idle_writer(look, patience) or _unkept(look, patience) or _unanswered(look, patience)


def _idle_writer(look: Look, patience: Patience) -> Verdict | None:
    stuck, facts = look.stuck, look.process
    if stuck is None or not lasted(stuck.for_ns, patience.hang_ms):
        return None
    if facts.writer is Sleep.NOT or not lasted(facts.writer_ns, patience.hang_ms):
        return None
    gone = facts.writer is Sleep.GONE
    fact = "the writer's thread is gone" if gone else "the writer's thread sleeps without processor time"
    return red(Diagnosis.NO_PROGRESS, Grade.CERTAIN if gone else Grade.LIKELY, stuck.since_ns, fact)


def _unkept(look: Look, patience: Patience) -> Verdict | None:
    unkept = look.unkept
    if unkept is None or not lasted(unkept.for_ns, patience.hang_ms):
        return None
    fact = f"event {unkept.answered_seq} was answered and is not committed"
    return red(Diagnosis.NO_PROGRESS, Grade.LIKELY, unkept.since_ns, fact)


def _unanswered(look: Look, patience: Patience) -> Verdict | None:
    found = look.unanswered
    if found is None or found.probes < PROBES_MIN or not lasted(found.for_ns, patience.hang_ms):
        return None
    fact = f"nothing was completed and no probe answered for {ms(found.for_ns)} ms while the loop turned"
    return red(Diagnosis.NO_PROGRESS, Grade.LIKELY, found.since_ns, fact)
