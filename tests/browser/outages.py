"""Outages that last as long as a test wants to look at them.

A core is back within a third of a second, too soon to press a key meanwhile. So the successor is stopped by the
kernel as soon as it exists, as on a machine that has no time for it, and goes on when the test has seen enough.
Nothing is told to the guard; to it this is a slow start.
"""

import contextlib
import signal
from collections.abc import Iterator

from tests.integration.house import House, Victim
from tests.waiting import until


@contextlib.contextmanager
def outage(house: House, number: int = signal.SIGKILL) -> Iterator[Victim]:
    """Hit the core; until the block ends no other one gets ready. Gives the one that was hit."""
    known = cores(house)
    old = house.hit("core", number)
    with held_start(house, known):
        yield old


@contextlib.contextmanager
def held_start(house: House, known: set[int]) -> Iterator[None]:
    """Stop the first core that is not known as soon as it is there; let it go on at the end."""
    (pid,) = until(lambda: cores(house) - known, "the next core to be started")
    successor = house.hold_pid(pid)
    successor.hit(signal.SIGSTOP)
    try:
        yield
    finally:
        with contextlib.suppress(ProcessLookupError):  # the guard may have given up on it
            successor.hit(signal.SIGCONT)


def cores(house: House) -> set[int]:
    """The pids of all cores of a house."""
    return {pid for pid, line in house.processes().items() if " -m core serve" in line}
