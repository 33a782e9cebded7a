"""Rule: something of the core was running out, and it was changed for another before that.

What the guard expected stands in its own words among the evidence. How memory went over the hours before is in the
state with which its recording begins; which kind of object grew is read off the core's censuses, where there are
two. All of it is likely and no more: a forecast is about what has not happened.
"""

from postmortem.analyzer.case import Case, Confidence, Finding
from postmortem.analyzer.out_of_memory import grown_types

_MIB = 1 << 20
_OF_MEMORY = frozenset({"LEAK", "MEMORY_PRESSURE"})


def examine(case: Case) -> list[Finding]:
    """Say what was running out, how it had grown, and what of."""
    diagnosis = case.incident.diagnosis
    if diagnosis not in _OF_MEMORY | {"FD_EXHAUSTION"}:
        return []
    evidence = tuple(f"{line.code}: {line.text}" for line in case.incident.evidence)
    foreseen = diagnosis != "MEMORY_PRESSURE"  # that is no forecast: it holds more than it may
    found = [Finding("ran_short", Confidence.LIKELY, {}, evidence)] if foreseen else []
    return [*_grown(case), *found, *grown_types(case)] if diagnosis in _OF_MEMORY else found


def _grown(case: Case) -> list[Finding]:
    course = case.tape.course
    if len(course) < 2 or course[-1][1] <= course[0][1]:
        return []
    (first_s, first), (last_s, last) = course[0], course[-1]
    values = {
        "minutes": str(max(1, round((last_s - first_s) / 60))),
        "first": str(first // _MIB),
        "last": str(last // _MIB),
    }
    lines = tuple(
        f"{-at_s / 60:.0f} min before: {held // _MIB} MiB"
        for at_s, held in course[:: max(1, len(course) // 6)]
    )
    return [Finding("leak", Confidence.LIKELY, values, lines)]
