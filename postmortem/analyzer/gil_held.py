"""Rule: one thread held the interpreter, and nothing else of the core could run.

The stacks say who has it. The frame is Python's last one before it went into the code that does not let go, so
its place is the call, not the line in C; that is as near as anybody gets without the symbols of that library.
"""

from postmortem.analyzer.blocked import frame_finding, thread_finding
from postmortem.analyzer.case import Case, Confidence, Finding


def examine(case: Case) -> list[Finding]:
    """Name the thread that held the interpreter and the frame it went out from."""
    if case.incident.diagnosis != "GIL_HELD":
        return []
    holder = next((thread for thread in case.threads if thread.holds_gil and thread.frames), None)
    if holder is None:
        return frame_finding(case, "gil_held", Confidence.LIKELY)
    return [thread_finding(case, holder, holder.frames[0], "gil_held", Confidence.CERTAIN)]
