"""Rule: somebody else killed the core.

SIGKILL never comes from inside, and the guard's own kills are steps of the timeline. Whether the kernel's
memory killer did it can't be read off the signal, so the finding says "from outside" and no more.
"""

from postmortem.analyzer.case import Case, Confidence, Finding

_SIGKILL = 9


def examine(case: Case) -> list[Finding]:
    """Say that the kill came from outside, unless the guard did it."""
    incident = case.incident
    by_us = any(step.step == "killed" for step in incident.timeline)
    if incident.exit.signal != _SIGKILL or by_us or incident.diagnosis == "OUT_OF_MEMORY":
        return []
    sure = Confidence.CERTAIN if incident.diagnosis == "KILLED_FROM_OUTSIDE" else Confidence.LIKELY
    evidence = ("exit status: signal 9 (SIGKILL)", "the guard had sent no SIGKILL")
    return [Finding("killed", sure, {}, evidence)]
