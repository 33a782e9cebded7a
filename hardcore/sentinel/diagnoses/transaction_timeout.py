"""TRANSACTION_TIMEOUT: the loop turns, and one command is being decided for longer than it may.

The recorder names the command and its limit; the kernel says that its thread was let and waits for no disk. Where
nobody could ask the kernel, it is given the longer patience on top and is only likely. A store that a
stranger has locked explains it, and then it is not the command's fault.
"""

from hardcore.model.verdicts import Diagnosis, Grade, Verdict
from hardcore.sentinel.lasting import NS_PER_MS
from hardcore.sentinel.look import Look, lasted, ms, red
from hardcore.sentinel.patience import Patience
from hardcore.sentinel.witnesses.transactions import Deciding


def judge(look: Look, patience: Patience) -> Verdict | None:
    """Return TRANSACTION_TIMEOUT with the command that is blamed, or None."""
    if look.ages.loop_stale(patience.late_ms) or look.store.holder is not None or look.disk.slow_since_ns:
        return None
    found = [one for one in look.deciding if _is_over(one, patience)]
    if not found:
        return None
    worst = max(found, key=lambda one: one.counted_ns - one.limit_ns)
    grade = Grade.CERTAIN if worst.sample is not None else Grade.LIKELY
    fact = f"its thread {_doing(worst)}: {ms(worst.counted_ns)} ms of its own time"
    return red(Diagnosis.TRANSACTION_TIMEOUT, grade, worst.since_ns, fact, blamed=(worst.note.command_id,))


def _is_over(one: Deciding, patience: Patience) -> bool:
    if not one.overdue or one.in_disk or not lasted(one.watched_ns, patience.conclusive_ms):
        return False
    return one.sample is not None or one.counted_ns >= one.limit_ns + patience.hang_ms * NS_PER_MS


def _doing(one: Deciding) -> str:
    if one.sample is None:
        return "was not looked at"
    match one.sample.state:
        case "":
            return "is gone"
        case "S":
            return f"sleeps in {one.sample.waits_in}" if one.sample.waits_in else "sleeps"
        case _:
            return "computes"
