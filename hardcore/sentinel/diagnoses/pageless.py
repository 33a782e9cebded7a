"""What can be said of a core whose page is no evidence: by the kernel and by its own silence, or not at all.

Without beats there is one kind of evidence less, so the other two must agree, and for the longer time: no answer when
asked for its health, several times in a row, and a kernel that says why. A stopped process is FROZEN; a loop asleep
on a lock, or in any other place than where a loop waits for work, is LOOP_BLOCKED. Both are only likely. A core that
computes is left alone, however long it is silent: whether anything comes of it stood on its page.
"""

import msgspec

from hardcore.model.verdicts import Diagnosis, Grade, Verdict
from hardcore.sentinel.look import lasted, ms, red
from hardcore.sentinel.patience import Patience
from hardcore.sentinel.witnesses.disk import DiskFindings
from hardcore.sentinel.witnesses.probe import PROBES_MIN, Unanswered
from hardcore.sentinel.witnesses.process_state import ProcessFacts, Sleep

#: Where a loop sleeps that has nothing to do, by kernel function or system call.
_AT_REST = ("ep_poll", "epoll")


class Remains(msgspec.Struct, frozen=True):
    """What a look finds that finds no page."""

    process: ProcessFacts
    unanswered: Unanswered | None
    disk: DiskFindings


def judge(look: Remains, patience: Patience) -> Verdict | None:
    """Return FROZEN or LOOP_BLOCKED, likely, or None."""
    silence = look.unanswered
    if silence is None or silence.probes < PROBES_MIN or not lasted(silence.for_ns, patience.hang_ms):
        return None
    diagnosis = _named(look, patience)
    if diagnosis is None:
        return None
    fact = f"{silence.probes} probes in a row were not answered, for {ms(silence.for_ns)} ms"
    return red(diagnosis, Grade.LIKELY, silence.since_ns, fact)


def _named(look: Remains, patience: Patience) -> Diagnosis | None:
    facts = look.process
    if facts.stopped and lasted(facts.stopped_ns, patience.hang_ms):
        return Diagnosis.FROZEN
    if look.disk.slow_since_ns or not _is_stuck(facts) or not lasted(facts.loop_ns, patience.hang_ms):
        return None
    return Diagnosis.LOOP_BLOCKED


def _is_stuck(facts: ProcessFacts) -> bool:
    if facts.loop is Sleep.OTHER:
        return facts.loop_waits_in != "" and not any(place in facts.loop_waits_in for place in _AT_REST)
    return facts.loop is Sleep.CONCLUSIVE
