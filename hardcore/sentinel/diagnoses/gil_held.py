"""GIL_HELD: neither beat goes on, because a thread has the interpreter and does not give it back.

If whoever has it sleeps, nobody in the process has any processor time: that can't end by itself soon, and is acted on
like a deadlock. If somebody computes, it may be a healthy large computation, so it must have *burned* the longer
limit; a collection of memory has its own. By the wall alone nobody is judged: on a loaded machine everything
takes long. A loop that is ready and not scheduled queues for a processor, not for the interpreter.
"""

from hardcore.model.verdicts import Diagnosis, Grade, Verdict
from hardcore.sentinel.look import Look, lasted, ms, red
from hardcore.sentinel.patience import Patience


def judge(look: Look, patience: Patience) -> Verdict | None:
    """Return GIL_HELD or None."""
    return _asleep(look, patience) or _computing(look, patience)


def _both_stale(look: Look, limit_ms: int) -> bool:
    return look.ages.loop_stale(limit_ms) and look.ages.thread_stale(limit_ms)


def _asleep(look: Look, patience: Patience) -> Verdict | None:
    known = look.processor.idle_known
    limit_ms = patience.conclusive_ms if known else patience.hang_ms
    if not lasted(look.processor.idle_ns, limit_ms) or not _both_stale(look, limit_ms):
        return None
    fact = (
        f"for {ms(look.processor.idle_ns)} ms both threads have waited for the interpreter, "
        f"and whoever has it sleeps{_holder(look)}"
    )
    grade = Grade.CERTAIN if known else Grade.LIKELY
    return red(Diagnosis.GIL_HELD, grade, look.ages.last_loop_ns, fact)


def _computing(look: Look, patience: Patience) -> Verdict | None:
    if not _both_stale(look, patience.hang_ms):
        return None
    spent = look.processor
    by_loop = _burned(spent.loop_burned_ns, spent.loop_all_ns, patience)
    by_other = lasted(spent.queued_ns, patience.hang_ms) and _burned(
        spent.held_burned_ns, spent.held_all_ns, patience
    )
    if not by_loop and not by_other:
        return None
    spent_ms = ms(spent.loop_all_ns if by_loop else spent.held_all_ns)
    name = "the loop's thread" if by_loop else "a thread"
    fact = f"{name} has computed for {spent_ms} ms and let nobody else run{_holder(look)}"
    grade = Grade.CERTAIN if by_loop else Grade.LIKELY
    return red(Diagnosis.GIL_HELD, grade, look.ages.last_loop_ns, fact)


def _burned(outside_ns: int, all_ns: int, patience: Patience) -> bool:
    """Whether a computation has had its time, or a computation and the collections of memory have had theirs."""
    return lasted(outside_ns, patience.hang_ms) or lasted(all_ns, max(patience.gc_grace_ms, patience.hang_ms))


def _holder(look: Look) -> str:
    return f" (the stacks say: {look.stacks.gil})" if look.stacks.gil else ""
