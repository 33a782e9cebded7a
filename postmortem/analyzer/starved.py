"""Rule: the machine had too little time for anybody, the guard included.

A guard that comes late itself has no right to call others late, so its own late looks stand in the recording; where
they are many, whatever else was found is to be read with them in mind. As a diagnosis of its own it never ends
anything, so here it is mostly a remark beside another one.
"""

from postmortem.analyzer.case import Case, Confidence, Finding
from postmortem.incident import mapping, text

#: Late looks in a recording of a minute or two that are worth a remark.
LATE_MIN = 5
_NS_PER_MS = 1_000_000
_RULES = {"STARVED": "starved", "SLEPT": "slept"}
_WITNESSES = frozenset({"guard", "machine", "clocks", "processor", "judge"})
_SHORT = ("late", "not scheduled", "slept", "busy")


def examine(case: Case) -> list[Finding]:
    """Say how late the guard itself was, and what the witnesses saw of the machine."""
    incident = case.incident
    late = case.tape.late_ns
    evidence = [
        f"{line.code}: {line.text}"
        for line in incident.evidence
        if line.code in _WITNESSES and any(word in line.text for word in _SHORT)
    ]
    if late:
        longest_ms = max(late) // _NS_PER_MS
        evidence.append(f"{len(late)} of the guard's own looks came late, the longest by {longest_ms} ms")
    evidence += [f"pressure: {name} = {one}" for name, one in _pressure(case)]
    rule = _RULES.get(incident.diagnosis)
    if rule is not None:
        return [Finding(rule, Confidence(incident.grade), {}, tuple(evidence))]
    if len(late) < LATE_MIN:
        return []
    return [Finding("busy_machine", Confidence.LIKELY, {"count": str(len(late))}, tuple(evidence))]


def _pressure(case: Case) -> list[tuple[str, str]]:
    told = mapping(case.process.get("pressure")) or mapping(case.memory.get("pressure"))
    return [(name, one) for name, raw in list(told.items())[:8] if (one := text(raw))]
