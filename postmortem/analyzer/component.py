"""Rule: one part of the core had stopped while the rest went on.

Each part notes its own beat on the recorder's page beside since when it has had work and for how long it may be silent,
so a silent part is told from one that has nothing to do by the page alone. Beside another diagnosis it is no more than
a sign, and told as likely.
"""

from postmortem.analyzer.case import Case, Confidence, Finding
from postmortem.incident import mappings, number, text

_NS_PER_S = 1_000_000_000


def examine(case: Case) -> list[Finding]:
    """Name each part whose beat was older than it may be while it had work."""
    taken_ns = number(case.recorder.get("taken_at_ns"))
    asked = case.incident.diagnosis == "COMPONENT_STALLED"
    if taken_ns is None:
        return [Finding("component_untold", Confidence.LIKELY, {}, _told(case))] if asked else []
    found = []
    for part in mappings(case.recorder.get("components")):
        since_ns, limit_ns = number(part.get("since_ns")) or 0, number(part.get("limit_ns")) or 0
        last_ns = max(number(part.get("beat_ns")) or 0, since_ns)
        if since_ns <= 0 or limit_ns <= 0 or taken_ns - last_ns <= limit_ns:
            continue
        name, silent = text(part.get("name")) or "?", (taken_ns - last_ns) / _NS_PER_S
        evidence = (
            f"the page: {name} was silent for {silent:.1f} s and may be for {limit_ns / _NS_PER_S:.1f} s",
        )
        sure = Confidence.CERTAIN if asked else Confidence.LIKELY
        found.append(Finding("component", sure, {"name": name, "seconds": f"{silent:.1f}"}, evidence))
    if asked and not found:
        return [Finding("component_untold", Confidence.LIKELY, {}, _told(case))]
    return found


def _told(case: Case) -> tuple[str, ...]:
    return tuple(f"{line.code}: {line.text}" for line in case.incident.evidence)
