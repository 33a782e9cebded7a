"""DISK_STALLED: a small write of our own does not come back, and neither does the core's.

It stands before the hangs because it explains some: a thread that waits for a disk can't be reached by anybody,
and a new core would wait for the same disk. It explains no loop that computes or sleeps on a timer: those are judged
as what they are.
"""

from hardcore.model.verdicts import Diagnosis, Grade, Verdict
from hardcore.sentinel.look import Look, lasted, ms, red
from hardcore.sentinel.patience import Patience


def judge(look: Look, patience: Patience) -> Verdict | None:
    """Return DISK_STALLED, certain, or None."""
    if not look.disk.slow_since_ns or not _explains(look, patience):
        return None
    waits = _in_disk(look)
    if not waits and not lasted(look.in_store_ns, patience.hang_ms):
        return None
    how = (
        "a thread of the core waits for a disk" if waits else f"the core waits for {ms(look.in_store_ns)} ms"
    )
    fact = f"{how}, and a small write of ours has taken {ms(look.disk.slow_ns)} ms"
    return red(Diagnosis.DISK_STALLED, Grade.CERTAIN, look.disk.slow_since_ns, fact)


def _in_disk(look: Look) -> bool:
    threads = (look.sample.loop, look.sample.writer, *(one.sample for one in look.deciding))
    return look.sample.state == "D" or any(thread is not None and thread.state == "D" for thread in threads)


def _explains(look: Look, patience: Patience) -> bool:
    if not look.ages.loop_stale(patience.late_ms):
        return True
    loop = look.sample.loop
    return loop is not None and (loop.state == "D" or "futex" in loop.waits_in)
