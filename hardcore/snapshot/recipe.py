"""Which evidence is taken, in which order, and until when: three tables and the arithmetic between them.

Every piece has a share of the budget, and its deadline is the sum of the shares up to its own: a piece that
is done early leaves its time to the later ones. One that is begun late, because the machine is busy, has its own
share all the same, as far as the whole allows. What a stop would
destroy comes before the stop, what is cheap and tells most comes before what is slow; what the kernel may keep
to itself for long is begun early and waited for last. A timeout per piece
without the sum was not chosen: six patient collectors in a row are one late kill.
"""

from collections.abc import Mapping
from enum import StrEnum

import msgspec


class Piece(StrEnum):
    """One thing to be collected, or a deed between two of them."""

    THREADS = "threads"  # where each thread sleeps; after the stop all of them read "do_signal_stop"
    ASK = "ask"  # the process is told to print its own stacks; a stopped one can't
    TASKS = "tasks"  # what is suspended on its loop, asked while the loop lives
    TRACEBACK = "traceback"  # what it printed meanwhile
    STOP = "stop"  # from here on nothing changes under the hands of the others
    DEBUGGER = "debugger"  # begins to read the stacks, and goes on beside the cheap pieces
    RECORDER = "recorder"
    PROCESS = "process"
    SAMPLE = "sample"  # the watch's last look at a process that is gone
    LOG = "log"
    LOCKS = "locks"  # who holds what in the data folder
    MEMORY = "memory"
    STACKS = "stacks"
    LAST_TRACEBACK = "last-traceback"  # what a dying process printed of its stacks


#: Per cent of the budget for each piece, in order. What is left to 100 belongs to the disk.
LIVING: Mapping[Piece, int] = {
    Piece.THREADS: 5,
    Piece.ASK: 1,
    Piece.TASKS: 8,
    Piece.TRACEBACK: 4,
    Piece.STOP: 25,
    Piece.DEBUGGER: 4,
    Piece.RECORDER: 4,
    Piece.PROCESS: 5,
    Piece.LOG: 3,
    Piece.STACKS: 23,
    Piece.LOCKS: 2,
    Piece.MEMORY: 2,
}
#: A core that goes on serving is only looked at.
LOOKED_AT: Mapping[Piece, int] = {piece: share for piece, share in LIVING.items() if piece is not Piece.STOP}
DEAD: Mapping[Piece, int] = {
    Piece.RECORDER: 30,
    Piece.SAMPLE: 5,
    Piece.LAST_TRACEBACK: 15,
    Piece.LOG: 20,
    Piece.LOCKS: 5,
    Piece.MEMORY: 5,
}
#: Of a gateway: it has no recorder of the core's form, no suspended commands, and no locks in the data folder.
OF_A_LIVING_GATEWAY: Mapping[Piece, int] = {
    Piece.THREADS: 10,
    Piece.DEBUGGER: 5,
    Piece.PROCESS: 10,
    Piece.LOG: 10,
    Piece.STACKS: 45,
}
OF_A_DEAD_GATEWAY: Mapping[Piece, int] = {Piece.LOG: 60}

#: Of a budget of one millisecond.
NS_PER_PERCENT = 10_000

#: Later than the last piece's deadline, so that a collector may still say that its time was over.
CUT_PERCENT = 90

#: A thread in an uninterruptible sleep doesn't stop; waiting longer for it would tell nothing new.
STOP_WAIT_MS_MAX = 100


class Step(msgspec.Struct, frozen=True):
    """One piece and the moment at which it must be done, in monotonic nanoseconds.

    `share_ns` is its own share of the budget: as long as a piece waits that asks somebody who may not answer.
    """

    piece: Piece
    until_ns: int
    share_ns: int

    def patience_ns(self, now_ns: int) -> int:
        """Return until when such a piece waits that is begun now."""
        return now_ns + self.share_ns

    def deadline_ns(self, now_ns: int, last_ns: int) -> int:
        """Return until when a piece that is begun now may take: its share at least, however late it begins.

        `last_ns` is the last piece's moment, which nothing goes beyond.
        """
        return min(last_ns, max(self.until_ns, self.patience_ns(now_ns)))


def plan(shares: Mapping[Piece, int], *, start_ns: int, budget_ms: int) -> tuple[Step, ...]:
    """Return the steps for one of the tables above, in order. `budget_ms` counts from `start_ns`."""
    assert budget_ms > 0, budget_ms
    steps, percent = [], 0
    for piece, share_percent in shares.items():
        percent += share_percent
        steps.append(
            Step(
                piece,
                start_ns + budget_ms * NS_PER_PERCENT * percent,
                budget_ms * NS_PER_PERCENT * share_percent,
            )
        )
    return tuple(steps)


def cut_ns(start_ns: int, budget_ms: int) -> int:
    """Return when a collector that overran its own deadline is left behind, in monotonic nanoseconds."""
    return start_ns + budget_ms * NS_PER_PERCENT * CUT_PERCENT


def end_ns(start_ns: int, budget_ms: int) -> int:
    """Return when the whole budget is over, in monotonic nanoseconds."""
    return start_ns + budget_ms * 1_000_000
