"""What will run out, and when: the words of the prediction.

A forecast is a claim about the future, so it carries what it was made from: a level, a limit, a slope with its lower
bound, and since when it has stood. Only one whose *lower* band reaches the limit within the horizon is ever told.
"""

from enum import StrEnum

import msgspec

from hardcore.model.verdicts import Diagnosis


class Resource(StrEnum):
    """What can run out."""

    MEMORY = "memory"  # bytes of the core, against its limit
    FDS = "fds"  # descriptors, against the process's own limit
    THREADS = "threads"
    QUEUE = "queue"  # commands that wait, against the slots
    DISK = "disk"  # bytes used on the ledger's file system, against its size
    ERRORS = "errors"  # errors and warnings in the core's log a minute, against what it usually says


#: What each is called as a diagnosis; the rest is only told of, because no other core would have more of it.
DIAGNOSES = {
    Resource.MEMORY: Diagnosis.LEAK,
    Resource.FDS: Diagnosis.FD_EXHAUSTION,
    Resource.THREADS: Diagnosis.LEAK,
    Resource.DISK: Diagnosis.DISK_FULL,
}


class Forecast(msgspec.Struct, frozen=True):
    """One resource that runs out. Times are monotonic; `per_hour` is the slope, `per_hour_low` its lower bound.

    `due_ns`: when the slope reaches the limit; `due_late_ns`: when its lower bound does, within the horizon.
    """

    resource: Resource
    level: float
    limit: float
    per_hour: float
    per_hour_low: float
    since_ns: int
    due_ns: int
    due_late_ns: int
    why: str
