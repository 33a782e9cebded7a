"""SPINNING: the thread beside it runs, the loop does not turn, and its thread computes all the time.

It must have *burned* the limit, since its last beat and since anything was completed. The same place in two looks
at the stacks makes it certain; without any look it is likely. Different places are a loop that works off a long queue:
overloaded, and getting on. It is left alone four times as long, because a restart would lose what it has done and
bring the same queue back; and not for ever, because nobody has had an answer in all that time.
"""

from hardcore.model.verdicts import Diagnosis, Grade, Verdict
from hardcore.sentinel.look import Look, lasted, ms, red
from hardcore.sentinel.patience import Patience

#: How many times longer a loop may compute that was never found in the same place twice.
MOVING_TIMES = 4


def judge(look: Look, patience: Patience) -> Verdict | None:
    """Return SPINNING or None."""
    if not look.alone or not look.ages.loop_stale(patience.hang_ms):
        return None
    times = MOVING_TIMES if look.stacks.loop_same is False else 1
    spent = look.processor
    grace_ms = max(patience.gc_grace_ms, patience.hang_ms)
    if not lasted(spent.loop_burned_ns, patience.hang_ms * times) and not lasted(
        spent.loop_all_ns, grace_ms * times
    ):
        return None
    grade = Grade.CERTAIN if look.stacks.loop_same else Grade.LIKELY
    fact = f"the loop's thread has computed for {ms(spent.loop_all_ns)} ms without a turn of the loop"
    return red(Diagnosis.SPINNING, grade, look.ages.last_loop_ns, fact)
