"""Outages that last as long as a test wants to look at them.

A core is back within a third of a second, too soon to press a key meanwhile. So the successor is stopped by the
kernel as soon as it exists, as on a machine that has no time for it, and goes on when the test has seen enough.
Nothing is told to the guard; to it this is a slow start.
"""

import contextlib
import signal
import subprocess
import sys
from collections.abc import Iterator
from typing import Final

from hardcore.host import page
from hardcore.model.recorder import CommandNote
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


#: Longer than any test holds it: the lock is let go by the end of its holder.
LOCK_S: Final = 60


@contextlib.contextmanager
def lost_answer(house: House, kind: str) -> Iterator[None]:
    """Press a button inside. At the end a command of this kind is committed, and the gateway died with its answer.

    The store's lock is held until the core has the command; then the gateway is stopped, the core commits and
    answers, and the gateway ends without having read a byte of that.
    """
    argv = [sys.executable, "-m", "core", "hold-lock", "--data", str(house.data), "--seconds", str(LOCK_S)]
    gateway = house.hold("gateway")
    before = {one.command_id for one in _commands(house)[1]}
    with subprocess.Popen(argv, env=house.environment(), stdout=subprocess.PIPE, text=True) as holder:
        try:
            assert holder.stdout is not None
            assert "Holding the write lock" in holder.stdout.readline()
            yield
            until(
                lambda: any(one.kind == kind for one in _commands(house)[0]), "the core to have the command"
            )
            gateway.hit(signal.SIGSTOP)
        finally:
            holder.kill()
    until(
        lambda: any(
            one.kind == kind and one.outcome == 201 and one.command_id not in before
            for one in _commands(house)[1]
        ),
        "the core to commit and answer",
    )
    gateway.hit(signal.SIGKILL)


def _commands(house: House) -> tuple[tuple[CommandNote, ...], tuple[CommandNote, ...]]:
    """The commands that the core has, and those that it has finished, as its recorder page says."""
    pid = house.status()["core"]["pid"]
    pages = [page.decode(path.read_bytes()) for path in house.folders.run.glob("recorder-*")]
    (mine,) = [one for one in pages if one is not None and one.pid == pid]
    return mine.in_flight, mine.finished
