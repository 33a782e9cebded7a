"""Waiting for a condition, never for a time.

A test that sleeps is slow on a fast machine and wrong on a loaded one. Here a test names what has to become
true; the deadline is generous, because it only says when to give up, not how fast anything has to be.
"""

import threading
import time
from collections.abc import Callable
from typing import Final, TypeVar

WAIT_S: Final = 20.0
_LOOK_EVERY_S: Final = 0.01

T = TypeVar("T")


def until(look: Callable[[], T], what: str, within_s: float = WAIT_S) -> T:
    """Look again and again until there is something true to see, and give that back.

    Raises AssertionError with `what` (said as a wish: "the core to be ready") after `within_s` seconds.
    """
    give_up_at = time.monotonic() + within_s
    pause = threading.Event()
    while not (seen := look()):
        assert time.monotonic() < give_up_at, f"waited {within_s:g} s for {what}"
        pause.wait(_LOOK_EVERY_S)
    return seen
