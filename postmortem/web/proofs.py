"""The drills that were run: what recovery was proven by, whoever asked for it.

The command line judges a drill and records what it found. One that was asked for from a page has nobody who waits for
its end; the incident that it made is the record then. Counting only the first kind was not chosen: who has just run a
drill here would read that none ever was.
"""

from typing import Final

from postmortem.views import Drill, Filter, Reads

#: Incidents that are looked through for drills, the newest ones.
LOOKED_THROUGH_MAX: Final = 200


def drills(reads: Reads, limit: int) -> list[Drill]:
    """Return the newest drills, each once; one that only left an incident went well if the core came back."""
    judged = list(reads.drills(limit))
    known = {one.incident for one in judged}
    lines = reads.incidents(Filter(), LOOKED_THROUGH_MAX).items
    left = [
        Drill(
            line.opened_at, line.drill, line.outcome == "recovered", line.outage_ms, line.id, scheduled=False
        )
        for line in lines
        if line.drill and line.closed_at is not None and line.id not in known
    ]
    return sorted([*judged, *left], key=lambda one: one.at, reverse=True)[:limit]
