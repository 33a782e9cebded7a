"""Rule: the core was stopped from outside (SIGSTOP, a debugger, a frozen group).

The states of the threads were read before the guard's own stop, so a "T" in them was somebody else's.
"""

from postmortem.analyzer.case import Case, Confidence, Finding
from postmortem.incident import mappings, text


def examine(case: Case) -> list[Finding]:
    """Say that every thread stood still before the guard touched it."""
    if case.incident.diagnosis != "FROZEN":
        return []
    states = [text(thread.get("state")) for thread in mappings(case.process.get("threads"))]
    stopped = sum(state in {"T", "t"} for state in states)
    if states and stopped == len(states):
        evidence = (f"{stopped} of {len(states)} threads were in state T before the evidence was taken",)
        return [Finding("frozen", Confidence.CERTAIN, {"threads": str(stopped)}, evidence)]
    evidence = (f"{stopped} of {len(states)} threads were in state T when the evidence was taken",)
    return [Finding("frozen", Confidence.LIKELY, {"threads": str(stopped)}, evidence)]
