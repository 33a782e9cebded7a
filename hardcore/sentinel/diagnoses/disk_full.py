"""DISK_FULL: the core says so, or the file system of its data folder has less room than the policy's floor.

Either alone is enough, because nobody is ended for it: the core serves reads until there is room. Both together are
certain. It explains no silence of the loop, so it stands behind the hangs.
"""

from hardcore.model.observations import StoreFault
from hardcore.model.verdicts import Diagnosis, Grade, Verdict
from hardcore.sentinel.look import Look, red
from hardcore.sentinel.patience import Patience


def judge(look: Look, patience: Patience) -> Verdict | None:
    """Return DISK_FULL or None."""
    told = look.store.told is StoreFault.FULL
    found = look.disk.full_since_ns
    if not told and not found:
        return None
    grade = Grade.CERTAIN if told and found else Grade.LIKELY
    began_ns = min(at_ns for at_ns in (look.store.told_ns if told else 0, found) if at_ns)
    fact = (
        f"{look.disk.free_bytes >> 20} MiB are free, {patience.disk_floor_bytes >> 20} MiB are wanted"
        if found
        else "the core could not write for lack of room"
    )
    return red(Diagnosis.DISK_FULL, grade, began_ns, fact)
