"""DEADLOCK: threads wait for each other's locks in a ring, and something that matters waits with them.

Two looks at the stacks must agree on the ring, and the recorder must agree that it hurts: the loop is silent and
in the ring, or a command is being decided by a thread in it. Without the right to read stacks the same hang is still
found, as a blocked loop or as a transaction over its time; only the ring stays without a name.
"""

from hardcore.model.verdicts import Diagnosis, Grade, Verdict
from hardcore.sentinel.look import Look, lasted, red
from hardcore.sentinel.patience import Patience


def judge(look: Look, patience: Patience) -> Verdict | None:
    """Return DEADLOCK, certain if the locks have names, or None."""
    cycle = look.stacks.cycle
    if cycle is None:
        return None
    limit_ms = patience.conclusive_ms if cycle.named else patience.hang_ms
    stuck = tuple(
        one
        for one in look.deciding
        if one.note.thread in cycle.tids and lasted(one.counted_ns, limit_ms) and not one.in_disk
    )
    looped = look.threads.loop in cycle.tids and look.ages.loop_stale(limit_ms)
    if not stuck and not looped:
        return None
    began_ns = min([one.since_ns for one in stuck] + ([look.ages.last_loop_ns] if looped else []))
    grade = Grade.CERTAIN if cycle.named else Grade.LIKELY
    blamed = tuple(one.note.command_id for one in stuck)
    return red(Diagnosis.DEADLOCK, grade, began_ns, blamed=blamed)
