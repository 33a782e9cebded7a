"""DISK_READ_ONLY: the file system of the data folder takes no writes; the kernel says so, or the core.

Nobody is ended for it, so either alone is enough; the kernel's own flag needs no second witness.
"""

from hardcore.model.observations import StoreFault
from hardcore.model.verdicts import Diagnosis, Grade, Verdict
from hardcore.sentinel.look import Look, red
from hardcore.sentinel.patience import Patience


def judge(look: Look, _: Patience) -> Verdict | None:
    """Return DISK_READ_ONLY or None."""
    told = look.store.told is StoreFault.READ_ONLY
    found = look.disk.read_only_since_ns
    if not told and not found:
        return None
    began_ns = min(at_ns for at_ns in (look.store.told_ns if told else 0, found) if at_ns)
    fact = "the file system of the data folder is read-only" if found else "the core may not write its store"
    return red(Diagnosis.DISK_READ_ONLY, Grade.CERTAIN if found else Grade.LIKELY, began_ns, fact)
