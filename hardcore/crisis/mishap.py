"""A bug of ours, described for the log without a word of what anybody sent.

A traceback's last line carries the exception's message, and messages carry values. Type and places are
enough to find the bug; the values belong to the people whose requests they were.
"""

import logging
import traceback
from collections.abc import Callable
from pathlib import PurePath

_LOG = logging.getLogger(__name__)

#: Frames named, the innermost last.
PLACES_MAX = 6


def describe(error: BaseException) -> str:
    """`AssertionError at moves.py:160 < client.py:88`."""
    frames = traceback.extract_tb(error.__traceback__)[-PLACES_MAX:]
    places = (f"{PurePath(frame.filename).name}:{frame.lineno}" for frame in reversed(frames))
    return f"{type(error).__name__} at {' < '.join(places)}"


def contained(what: str, step: Callable[[], None]) -> bool:
    """Run a step whose bug must reach nobody else; False, and a line in the log, if it had one."""
    try:
        step()
    except Exception as error:  # noqa: BLE001 - whatever it was, it belongs to this step alone
        _LOG.error("%s failed: %s", what, describe(error))
        return False
    return True
