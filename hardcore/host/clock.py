"""Time, asked here and nowhere else.

Monotonic nanoseconds for every decision; the wall clock only as a label in reports, through one offset
taken at the moment of writing, so that a clock that jumps can't reorder a story.
"""

import datetime as dt
import time
from pathlib import Path

from hardcore.model.clocks import Clocks

#: Clocks that are read within this time are read together, and this often it is tried.
TOGETHER_NS = 10_000_000
READINGS_MAX = 4

_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


def now_ns() -> int:
    """Return the monotonic time that every process of this machine shares."""
    return time.monotonic_ns()


def together() -> tuple[int, Clocks]:
    """Return the time, and what the two other clocks say at that moment: one counts sleep, one is set by people.

    They are read one after the other, and again if we were kept from that for so long in between that one would
    seem to have run ahead.
    """
    for _ in range(READINGS_MAX - 1):
        at_ns, others = now_ns(), _others()
        if now_ns() - at_ns <= TOGETHER_NS:
            return at_ns, others
    return now_ns(), _others()


def _others() -> Clocks:
    return Clocks(time.clock_gettime_ns(time.CLOCK_BOOTTIME), time.time_ns())


def wall(at_ns: int) -> str:
    """Return the moment `at_ns` as RFC 3339 in UTC, in milliseconds, by today's wall clock."""
    offset_ns = time.time_ns() - time.monotonic_ns()
    moment = dt.datetime.fromtimestamp((at_ns + offset_ns) / 1e9, tz=dt.UTC)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def boot_id() -> str:
    """Return the id of this boot of the machine."""
    return _BOOT_ID.read_text("ascii").strip()
