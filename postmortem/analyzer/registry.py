"""The rules, in the order in which their findings are told.

An explicit list: a rule that finds itself by being in a folder is one that nobody decided on.
"""

import hashlib

from postmortem.analyzer import (
    blocked,
    crashed,
    deadlock,
    disk,
    exited,
    frozen,
    gil_held,
    killed,
    locked_out,
    no_progress,
    operator,
    out_of_memory,
    over_time,
)
from postmortem.analyzer.case import Case, Confidence, Finding, Rule

RULES: tuple[Rule, ...] = (
    operator.examine,
    crashed.examine,
    exited.examine,
    killed.examine,
    out_of_memory.examine,
    frozen.examine,
    blocked.examine,
    gil_held.examine,
    deadlock.examine,
    over_time.examine,
    locked_out.examine,
    disk.examine,
    no_progress.examine,
)
_ORDER = tuple(Confidence)


def examine(case: Case) -> tuple[Finding, ...]:
    """Return what all rules find in the case, the surest first."""
    findings = [finding for rule in RULES for finding in rule(case)]
    return tuple(sorted(findings, key=lambda finding: _ORDER.index(finding.confidence)))


def fingerprint(case: Case, findings: tuple[Finding, ...]) -> str:
    """Return 16 hex digits that are the same whenever the same thing happens again.

    Made of the diagnosis and where it happened: the function and file of a frame, else the signal or code,
    else the kind of the command at work. Line numbers and ids stay out: an edit above the fault, or another
    customer, is not another fault.
    """
    named = next((finding.values for finding in findings if finding.values.get("place")), None)
    incident = case.incident
    if named is not None:
        # "handler (file.py:12)" of a crash and ("handler", "file.py:12") of a hang are the same place.
        where = f"{named.get('function', '')} {named['place']}".strip().rpartition(":")[0].replace("(", "")
    elif incident.exit.signal is not None or incident.exit.code is not None:
        where = f"signal {incident.exit.signal} code {incident.exit.code}"
    else:
        kinds = [one.kind for one in incident.in_flight if one.stage == "DECIDING"]
        where = f"kind {kinds[0]}" if kinds else ""
    return hashlib.sha256(f"{incident.diagnosis}\n{where}".encode("utf-8", "backslashreplace")).hexdigest()[
        :16
    ]
