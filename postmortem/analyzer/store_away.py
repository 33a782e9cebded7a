"""Rule: the server that the ledger lies in could not be reached, and a restart would not have helped.

A core that was to begin has said so itself, in its last words; there is nothing to weigh. No command is to blame.
"""

from postmortem.analyzer.case import Case, Confidence, Finding

_AWAY = "STORE_AWAY"


def examine(case: Case) -> list[Finding]:
    """Say that the server was away, with how many starts have met that."""
    incident = case.incident
    met = sum(death.diagnosis == _AWAY for death in incident.deaths)
    if not met and _AWAY not in {incident.diagnosis, incident.waits_for}:
        return []
    evidence = [f"last words: {_AWAY}", *([f"starts that met it: {met}"] if met else [])]
    return [Finding("store_away", Confidence.CERTAIN, {}, tuple(evidence))]
