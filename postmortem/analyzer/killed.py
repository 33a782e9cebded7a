"""Rule: somebody else killed the core.

SIGKILL never comes from inside, and only the guard knows whether it was its own: so its diagnosis is asked,
not the signal alone. Whether the kernel's memory killer did it can't be read off the signal either, so the
finding says "from outside" and no more.
"""

from postmortem.analyzer.case import Case, Confidence, Finding

_SIGKILL = 9


def examine(case: Case) -> list[Finding]:
    """Say that the kill came from outside, where the guard says that it did not do it."""
    if case.incident.diagnosis != "KILLED_FROM_OUTSIDE":
        return []
    number = case.incident.exit.signal
    status = f"exit status: signal {number}" if number is not None else "exit status: nobody could read it"
    sure = Confidence.CERTAIN if number == _SIGKILL else Confidence.LIKELY
    return [Finding("killed", sure, {}, (status, "the guard had sent no SIGKILL"))]
