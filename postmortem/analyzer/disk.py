"""Rule: the disk took no write, took it too slowly, or had no room.

As sure as the guard was when it looked: the disk of an hour ago can't be asked again. No command is to blame.
"""

from postmortem.analyzer.case import Case, Confidence, Finding

_RULES = {"DISK_FULL": "disk_full", "DISK_READ_ONLY": "disk_read_only", "DISK_STALLED": "disk_stalled"}
_WITNESSES = frozenset({"disk", "store", "core", "death"})


def examine(case: Case) -> list[Finding]:
    """Say what was wrong with the disk, with what the witnesses saw of it."""
    incident = case.incident
    rule = _RULES.get(incident.diagnosis) or _RULES.get(incident.waits_for or "")
    if rule is None:
        return []
    seen = tuple(f"{line.code}: {line.text}" for line in incident.evidence if line.code in _WITNESSES)
    sure = Confidence(incident.grade) if incident.diagnosis in _RULES else Confidence.LIKELY
    return [Finding(rule, sure, {}, seen or ("no witness of the disk is on record",))]
