"""LOOP_BLOCKED: the loop's thread sleeps where it should turn.

While the thread beside it goes on, a loop asleep on a lock or a timer is blocked for certain; asleep in another wait
(a socket, a poll) it is given more time. If neither beat goes on and the whole process sleeps without any processor
time, the loop is over and idle threads keep its process alive.
"""

from hardcore.model.verdicts import Diagnosis, Grade, Verdict
from hardcore.sentinel.look import Look, lasted, red
from hardcore.sentinel.patience import Patience
from hardcore.sentinel.witnesses.process_state import Sleep


def judge(look: Look, patience: Patience) -> Verdict | None:
    """Return LOOP_BLOCKED or None."""
    return _blocked(look, patience) if look.alone else _ended(look, patience)


def _blocked(look: Look, patience: Patience) -> Verdict | None:
    if look.process.loop not in {Sleep.CONCLUSIVE, Sleep.OTHER}:
        return None
    sure = look.process.loop is Sleep.CONCLUSIVE
    limit_ms = patience.conclusive_ms if sure else patience.hang_ms
    if not lasted(look.process.loop_ns, limit_ms) or not look.ages.loop_stale(limit_ms):
        return None
    grade = Grade.CERTAIN if sure else Grade.LIKELY
    return red(Diagnosis.LOOP_BLOCKED, grade, look.ages.last_loop_ns)


def _ended(look: Look, patience: Patience) -> Verdict | None:
    """Judge a core whose loop and whose beats' thread are both over while some thread keeps it alive.

    A held interpreter looks like it, but somebody computes then, or whoever waits for it wakes up again
    and again: so the loop must have slept on a lock, and the whole process without processor time.
    """
    facts = look.process
    lasted_ns = min(look.ages.loop_ns, look.ages.thread_ns, facts.loop_ns, facts.quiet_ns)
    if facts.loop is not Sleep.CONCLUSIVE or not lasted(lasted_ns, patience.hang_ms):
        return None
    fact = "no thread of the process had any processor time meanwhile"
    return red(Diagnosis.LOOP_BLOCKED, Grade.LIKELY, look.ages.last_loop_ns, fact)
