"""DB_LOCKED: the core waits in the store, and somebody else has its write lock.

The lock is read from the kernel's table, from outside; the waiting from the recorder. The same stranger must have been
found in two looks, and both must have lasted. A restart would only wait for the same lock: the holder is named.
"""

from hardcore.model.verdicts import Diagnosis, Grade, Verdict
from hardcore.sentinel.look import Look, lasted, ms, red
from hardcore.sentinel.patience import Patience
from hardcore.sentinel.witnesses.store import who

LOOKS_MIN = 2


def judge(look: Look, patience: Patience) -> Verdict | None:
    """Return DB_LOCKED or None."""
    holder = look.store.holder
    if holder is None or look.store.looks < LOOKS_MIN or not look.in_store_ns:
        return None
    # Not the time of this one wait: a core that gives up and asks again begins it anew each time.
    if not lasted(look.store.held_ns, patience.hang_ms):
        return None
    fact = f"{who(holder)} has held the store's write lock for {ms(look.store.held_ns)} ms while the core waits for it"
    grade = Grade.CERTAIN if holder.pid else Grade.LIKELY
    return red(Diagnosis.DB_LOCKED, grade, look.store.held_since_ns, fact)
