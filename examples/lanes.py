"""Who may go next: work is handed to several senders at once, yet each account sees its own in order.

A transaction stands in the line of every account it touches and is ready when it is first in all of them; so a
coffee on the credit card and a purchase of shares go side by side, and two coffees do not. That is how much
at once a household's software may have under way without booking anything before what it rests on.
"""

import heapq
import threading
from collections import deque
from collections.abc import Sequence


class Lanes:
    """The lines, one for each account, shared by all senders."""

    def __init__(self, touched: Sequence[tuple[str, ...]]) -> None:
        """`touched` names the accounts of each piece of work, in the order of the work."""
        self._touched = touched
        self._lines: dict[str, deque[int]] = {}
        self._first_in = [0] * len(touched)
        self._ready: list[int] = []
        self._done = 0
        self._gate = 0
        self._closed = False
        self._changed = threading.Condition()
        for number, accounts in enumerate(touched):
            for account in accounts:
                line = self._lines.setdefault(account, deque())
                line.append(number)
                if len(line) == 1:
                    self._now_first(number)

    @property
    def done(self) -> int:
        """How many are done."""
        return self._done

    def open_up_to(self, number: int) -> None:
        """Let the work before this number go; the rest waits for another call."""
        with self._changed:
            self._gate = number
            self._changed.notify_all()

    def take(self) -> int | None:
        """Wait for work that may go; None when there is none left."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._over() or self._may_go())
            return None if self._closed or self._over() else heapq.heappop(self._ready)

    def finish(self, number: int) -> None:
        """Say that this work is done: who stands behind it moves up."""
        with self._changed:
            for account in self._touched[number]:
                line = self._lines[account]
                assert line.popleft() == number, "only the first of a line was under way"
                if line:
                    self._now_first(line[0])
            self._done += 1
            self._changed.notify_all()

    def wait_for(self, done: int, within_s: float) -> bool:
        """Wait until so many are done; return whether they are, or all is closed."""
        with self._changed:
            return self._changed.wait_for(lambda: self._closed or self._done >= done, within_s)

    def close(self) -> None:
        """Hand out nothing more."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _now_first(self, number: int) -> None:
        self._first_in[number] += 1
        if self._first_in[number] == len(self._touched[number]):
            heapq.heappush(self._ready, number)

    def _over(self) -> bool:
        return self._done == len(self._touched)

    def _may_go(self) -> bool:
        return bool(self._ready) and self._ready[0] < self._gate
