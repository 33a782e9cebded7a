"""Rule: somebody else held the ledger's store, and a restart would not have helped.

Who it was stands in the kernel's table of locks, as the evidence has it; where nobody is named there, the guard's
own look is told. No command of the core is to blame.
"""

from postmortem.analyzer.case import Case, Confidence, Finding
from postmortem.incident import mappings, number, text


def examine(case: Case) -> list[Finding]:
    """Name the program that held the store's write lock."""
    if "DB_LOCKED" not in {case.incident.diagnosis, case.incident.waits_for}:
        return []
    holders = [one for one in mappings(case.locks.get("store_write_lock")) if one.get("ours") is not True]
    told = tuple(line.text for line in case.incident.evidence if line.code == "store")
    if not holders:
        return [Finding("locked_out", Confidence.LIKELY, {}, told or ("no holder is on record",))]
    found = []
    for holder in holders:
        name, pid = text(holder.get("name")) or "?", str(number(holder.get("pid")) or "?")
        evidence = (f"the kernel's table of locks: process {pid} ({name}) has the store's write lock", *told)
        values = {"name": name, "pid": pid}
        found.append(Finding("locked_out_by", Confidence.CERTAIN, values, evidence))
    return found
