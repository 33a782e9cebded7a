"""Rule: the kernel ended the core because memory had run out.

That it did is the guard's word, which saw the counter rise. How it grew is read off the watch's looks, what had grown is read off the core's own last two
censuses: likely at best, because a census counts objects and not what lies behind them.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from postmortem.analyzer.case import Case, Confidence, Finding
from postmortem.analyzer.tape import curve
from postmortem.incident import mapping, mappings, number, text

_MIB = 1 << 20
_TYPES_SHOWN = 5
_RECENT_S = 30.0


def examine(case: Case) -> list[Finding]:
    """Say how large the core was, and which kind of object had grown most."""
    if case.incident.diagnosis != "OUT_OF_MEMORY":
        return []
    evidence = [f"{line.code}: {line.text}" for line in case.incident.evidence]
    grown = curve(case.tape, case.incident.pid)
    sample = number(mapping(case.process.get("last_sample")).get("rss_bytes"))
    rss_bytes = sample or (grown[-1][1] if grown else None)  # of a process that has ended the kernel says 0
    if rss_bytes is not None:
        evidence.append(f"the watch's last look: {rss_bytes // _MIB} MiB in memory")
    if len(grown) > 1:
        evidence.append(_course(grown))
    evidence += [f"memory group: {name} = {_one_line(value)}" for name, value in _group(case).items()]
    values = {} if rss_bytes is None else {"mib": str(rss_bytes // _MIB)}
    rule = "out_of_memory" if values else "out_of_memory_unsized"
    found = [Finding(rule, Confidence(case.incident.grade), values, tuple(evidence))]
    return [*found, *grown_types(case)]


def grown_types(case: Case) -> list[Finding]:
    """Say which kind of object had grown most between the last two censuses, if there are two."""
    types = [one for one in mappings(_growth(case).get("types")) if (number(one.get("size_bytes")) or 0) > 0]
    if not types:
        return []
    lines = tuple(_line(one) for one in types[:_TYPES_SHOWN])
    return [Finding("grew", Confidence.LIKELY, {"type": text(types[0].get("name"))}, lines)]


def _course(grown: Sequence[tuple[float, int]]) -> str:
    """Say where the last steep growth began: at the lowest point of the last half minute."""
    recent = [point for point in grown if point[0] >= -_RECENT_S]
    low = min(recent, key=lambda point: point[1])
    return (
        f"it grew from {low[1] // _MIB} MiB to {max(held for _, held in recent) // _MIB} MiB "
        f"in its last {-low[0]:.1f} s"
    )


def _growth(case: Case) -> Mapping[str, Any]:
    return mapping(case.memory.get("growth"))


def _group(case: Case) -> Mapping[str, Any]:
    return mapping(case.memory.get("group"))


def _line(kind: Mapping[str, Any]) -> str:
    count, size = number(kind.get("count")) or 0, number(kind.get("size_bytes")) or 0
    return (
        f"{text(kind.get('name'))}: {count:+,} objects, {size / _MIB:+.1f} MiB between the last two censuses"
    )


def _one_line(value: object) -> str:
    return " ".join(text(value).split())
