"""Breaks this core on purpose, so that its owner can watch it come back.

A drill is the real fault, not a picture of it: the process aborts, leaves, stops or blocks its event loop
exactly as it would in an accident, and nothing in the recovery can tell the difference. The one way in is
the core's control socket, which only its owner can open; whether drills are allowed is the guard's policy.
"""

import os
import signal
import time
from enum import StrEnum
from typing import assert_never

#: How long `block` blocks: longer than any guard waits.
BLOCK_S = 86_400
EXIT_CODE = 3


class Drill(StrEnum):
    """The faults a core can make by itself."""

    CRASH = "crash"  # a fatal signal of its own
    EXIT = "exit"  # leaves without being asked and without a word
    FREEZE = "freeze"  # stopped as a whole, as by a debugger
    BLOCK = "block"  # the event loop waits, everything else goes on


def carry_out(drill: Drill) -> None:
    """Break now, on the thread of the event loop. Returns only when somebody heals the fault."""
    match drill:
        case Drill.CRASH:
            os.abort()
        case Drill.EXIT:
            os._exit(EXIT_CODE)
        case Drill.FREEZE:
            os.kill(os.getpid(), signal.SIGSTOP)
        case Drill.BLOCK:
            time.sleep(BLOCK_S)
        case _:
            assert_never(drill)
