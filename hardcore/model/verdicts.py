"""The words of a judgement: what one witness says, and what all of them together mean.

A witness gives a `Testimony`: a colour and why. `sentinel/verdict.py` weighs them into a `Verdict`. A
diagnosis that this version can't make yet is still a word here, because a policy may already name it.
"""

from enum import StrEnum

import msgspec


class Colour(StrEnum):
    """Green: well. Yellow: worth saying. Red: something must be done."""

    GREEN = "green"
    YELLOW = "yellow"
    RED = "red"


class Grade(StrEnum):
    """How sure a diagnosis is."""

    CERTAIN = "certain"
    LIKELY = "likely"
    UNKNOWN = "unknown"


class Diagnosis(StrEnum):
    """What is wrong. The evidence behind each stands in the manual's table of diagnoses."""

    CRASHED = "CRASHED"
    EXITED = "EXITED"
    KILLED_FROM_OUTSIDE = "KILLED_FROM_OUTSIDE"
    STOPPED_FROM_OUTSIDE = "STOPPED_FROM_OUTSIDE"
    OUT_OF_MEMORY = "OUT_OF_MEMORY"
    FENCED = "FENCED"
    COMMIT_FAILED = "COMMIT_FAILED"
    FROZEN = "FROZEN"
    LOOP_BLOCKED = "LOOP_BLOCKED"
    SPINNING = "SPINNING"
    GIL_HELD = "GIL_HELD"
    DEADLOCK = "DEADLOCK"
    TRANSACTION_TIMEOUT = "TRANSACTION_TIMEOUT"
    NO_PROGRESS = "NO_PROGRESS"
    DB_LOCKED = "DB_LOCKED"
    STORE_AWAY = "STORE_AWAY"
    DISK_FULL = "DISK_FULL"
    DISK_READ_ONLY = "DISK_READ_ONLY"
    DISK_STALLED = "DISK_STALLED"
    STORE_CORRUPT = "STORE_CORRUPT"
    COMPONENT_STALLED = "COMPONENT_STALLED"
    MEMORY_PRESSURE = "MEMORY_PRESSURE"
    LEAK = "LEAK"
    FD_EXHAUSTION = "FD_EXHAUSTION"
    STARTUP_FAILED = "STARTUP_FAILED"
    CRASH_LOOP = "CRASH_LOOP"
    CONFIG_INVALID = "CONFIG_INVALID"
    STARVED = "STARVED"
    SLEPT = "SLEPT"
    SENTINEL_LOST = "SENTINEL_LOST"
    GATEWAY_LOST = "GATEWAY_LOST"
    SPARE_LOST = "SPARE_LOST"
    OPERATOR = "OPERATOR"
    PLANNED_SWITCH = "PLANNED_SWITCH"


class Testimony(msgspec.Struct, frozen=True):
    """What one witness says: its name, its colour, and the fact behind it as one sentence."""

    witness: str
    colour: Colour
    why: str


class Wish(StrEnum):
    """What the judge would like to know next, because something is suspicious; asking is free for the core."""

    STACKS = "stacks"
    STORE = "store"


class Verdict(msgspec.Struct, frozen=True):
    """The weighed judgement. `fault_ns` is when it began as far as anybody can tell; 0 when green.

    `blamed` are the ids of the commands that the evidence names. A red verdict has a diagnosis; a yellow one may
    have (STARVED, SLEPT), and is never acted on.
    """

    colour: Colour
    diagnosis: Diagnosis | None = None
    grade: Grade = Grade.UNKNOWN
    fault_ns: int = 0
    testimonies: tuple[Testimony, ...] = ()
    wishes: frozenset[Wish] = frozenset()
    blamed: tuple[str, ...] = ()
    component: str = ""  # COMPONENT_STALLED: which part


GREEN = Verdict(Colour.GREEN)
