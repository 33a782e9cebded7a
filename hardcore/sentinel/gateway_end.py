"""Judges whether a gateway may have ended over what it was reading: only such an end makes a path suspect.

A request that is half sent is being read for as long as its client likes, so at every death some innocent one is there.
What is refused after two deaths must therefore have been there in two that reading can cause: a crash of the parser, an
end by an error, a loop that never came back from it, or memory that ran out because this process took it. Whoever was
killed or stopped from outside, or as a drill, or whose end nobody could read, says nothing about a path. Counting every
death was not chosen: one slow client and two kills would have shut everybody out of the ledger.
"""

from hardcore.model.observations import Exit
from hardcore.model.verdicts import Diagnosis

#: Linux gives these numbers everywhere that we run; this room knows no machine.
SIGILL, SIGABRT, SIGBUS, SIGFPE, SIGKILL, SIGSEGV = 4, 6, 7, 8, 9, 11
#: What a fault in native code, a parser's above all, ends a process with.
CRASHES = frozenset({SIGSEGV, SIGABRT, SIGBUS, SIGILL, SIGFPE})
#: A loop that computes and does not come back may do so over what it reads; one that waits for something does not.
COMPUTES = frozenset({Diagnosis.GIL_HELD, Diagnosis.SPINNING})
#: A gateway that has grown by less is not why memory ran out.
GREW_BYTES = 64 << 20


def may_be_of_reading(
    how: Exit, judged: Diagnosis | None, *, drill: bool, oom_kills: int | None, grown_bytes: int
) -> bool:
    """Return whether reading a request can have caused this end.

    `judged`: as what we have ended it ourselves, if we have. `oom_kills`: the kernel's kills for memory in its life.
    """
    if drill:
        return False
    if judged is not None:
        return judged in COMPUTES
    if how.signal is None:
        return how.code is not None and how.code != 0
    if how.signal == SIGKILL:
        return bool(oom_kills) and grown_bytes >= GREW_BYTES
    return how.signal in CRASHES
