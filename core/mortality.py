"""Dying with whoever began us: the kernel ends a child whose parent is gone, however that one ended.

A parent that ends its children in a `finally` leaves them where it is killed, and being killed is what this house is made
for. Not chosen: a pipe whose end the child would watch, which takes a thread of a child that is busy.
"""

import ctypes
import os
import signal
from typing import Final

_PR_SET_PDEATHSIG: Final = 1  # prctl(2)
_LIBC: Final = ctypes.CDLL(None)  # loaded here, before anybody forks


def die_with(parent: int) -> bool:
    """Have the kernel kill this process when the thread of `parent` that made it ends; return whether `parent` still lives.

    It may have died before the kernel was asked: then nothing will ever come, and the caller has to leave by himself.
    """
    _LIBC.prctl(_PR_SET_PDEATHSIG, ctypes.c_ulong(signal.SIGKILL))
    return os.getppid() == parent
