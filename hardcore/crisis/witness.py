"""The highest commit that a client was told of: the gateway's own word on where the ledger had got to.

The core's page is the first witness of a commit and dies with its machine's memory; this is the second, kept by
another process. It is said on change, but not more often than somebody needs it: every booking has a commit, and a
line for each would cost more than the booking's way through here. What was not heard is said again, and a sentinel
that has just begun hears the last one whole. Keeping all of them was not chosen: the highest one stands for every
commit before it, because each event's hash covers the one before.
"""

import asyncio

from hardcore.crisis.feed import Teller, witness_line
from hardcore.crisis.heads import Commit


class Witness:
    """Remembers one commit, and tells it."""

    def __init__(self, loop: asyncio.AbstractEventLoop, teller: Teller, at_most_every_ms: int) -> None:
        self._loop = loop
        self._teller = teller
        self._pause_s = at_most_every_ms / 1000
        self._epoch = 0
        self._commit: Commit | None = None
        self._due = False  # nobody has heard it yet
        self._pause: asyncio.TimerHandle | None = None

    def saw(self, epoch: int, commit: Commit) -> None:
        """A client was told of `commit`."""
        if self._commit is not None and (epoch, commit.seq) <= (self._epoch, self._commit.seq):
            return
        self._epoch, self._commit, self._due = epoch, commit, True
        if self._pause is None:
            self.tell()

    def repeat(self) -> None:
        """Whoever heard it is gone: say it again."""
        self._due = self._commit is not None
        self.tell()

    def tell(self) -> None:
        """Say it now, unless it was heard."""
        commit = self._commit
        if not self._due or commit is None:
            return
        self._due = not self._teller.say(witness_line(self._epoch, commit.seq, commit.hash))
        if self._pause is None:
            self._pause = self._loop.call_later(self._pause_s, self._again)

    def _again(self) -> None:
        self._pause = None
        self.tell()

    def close(self) -> None:
        """Tell what is left, and nothing more."""
        self.tell()
        if self._pause is not None:
            self._pause.cancel()
            self._pause = None
