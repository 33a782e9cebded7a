"""A bug of ours, described for the log without a word of what anybody sent.

A traceback's last line carries the exception's message, and messages carry values. Type and places are
enough to find the bug; the values belong to the people whose requests they were.
"""

import traceback
from pathlib import PurePath

#: Frames named, the innermost last.
PLACES_MAX = 6


def describe(error: BaseException) -> str:
    """`AssertionError at moves.py:160 < client.py:88`."""
    frames = traceback.extract_tb(error.__traceback__)[-PLACES_MAX:]
    places = (f"{PurePath(frame.filename).name}:{frame.lineno}" for frame in reversed(frames))
    return f"{type(error).__name__} at {' < '.join(places)}"
