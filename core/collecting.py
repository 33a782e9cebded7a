"""Collecting garbage: when a core begins to look for it, and how seldom.

What was loaded lives as long as the process and is set aside for good. What comes after is nearly all freed by its last
owner, and a book is booked in thousands of rows at a time that are all needed until they are written: to look through
them after every 700 objects, as Python does by itself, cost a tenth of every booking. Not chosen: to collect never; a
cycle that somebody leaves behind by mistake would then be a leak.
"""

import gc
from typing import Final

#: New objects between two looks at the youngest; over in a millisecond.
YOUNG_MAX: Final = 10_000


def collect_from_now_on() -> None:
    """Set what there is aside, and look for garbage among what comes."""
    gc.freeze()
    gc.set_threshold(YOUNG_MAX, *gc.get_threshold()[1:])
    gc.enable()
