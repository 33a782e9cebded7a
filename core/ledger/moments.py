"""Moments: wall time as events and answers spell it, RFC 3339 in UTC with all nine digits.

One spelling and one way back, so that a time in an event is the same number of nanoseconds for whoever reads it: the
moment at which a pending transaction runs out is part of the book and must not depend on how somebody rounds.
"""

import datetime as dt
import re
from functools import lru_cache
from typing import Final

SECOND_NS: Final = 1_000_000_000
SECONDS_KNOWN_MAX: Final = 64  # that are remembered as they are spelled
_EPOCH: Final = dt.datetime(1970, 1, 1, tzinfo=dt.UTC)
_SPELLED: Final = re.compile(r"(\d{4}-\d{2}-\d{2}T\d{2}:\d{2}:\d{2})\.(\d{9})Z", re.ASCII)


def timestamp(wall_ns: int) -> str:
    """Return wall time in nanoseconds since 1970 as RFC 3339 in UTC, to the nanosecond."""
    seconds, rest_ns = divmod(wall_ns, SECOND_NS)
    return f"{_second(seconds)}.{rest_ns:09d}Z"


@lru_cache(maxsize=SECONDS_KNOWN_MAX)
def _second(seconds: int) -> str:
    """Return a second: thousands of events fall into one, and each is told more than once."""
    return f"{dt.datetime.fromtimestamp(seconds, dt.UTC):%Y-%m-%dT%H:%M:%S}"


def moment_ns(text: str) -> int | None:
    """Return the nanoseconds since 1970 of a time that `timestamp` has spelled, None of anything else."""
    found = _SPELLED.fullmatch(text)
    if found is None:
        return None
    try:
        day = dt.datetime.fromisoformat(f"{found[1]}+00:00")
    except ValueError:
        return None
    since = day - _EPOCH
    return (since.days * 86_400 + since.seconds) * SECOND_NS + int(found[2])
