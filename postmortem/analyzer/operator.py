"""Rule: somebody wanted it. An operator's word or a drill is no fault, and the report must not call it one."""

from postmortem.analyzer.case import Case, Confidence, Finding


def examine(case: Case) -> list[Finding]:
    """Name the drill or the operator's reason, where the incident was asked for."""
    incident = case.incident
    if incident.drill:
        evidence = (f"the guard had ordered the drill {incident.drill!r}",)
        return [Finding("drill", Confidence.CERTAIN, {"drill": incident.drill}, evidence)]
    if not incident.planned and incident.diagnosis not in {"OPERATOR", "PLANNED_SWITCH"}:
        return []
    reason = incident.reason or ""
    evidence = (f"reason given: {reason}",) if reason else ("no reason was given",)
    rule = "operator_reason" if reason else "operator"
    return [Finding(rule, Confidence.CERTAIN, {"reason": reason}, evidence)]
