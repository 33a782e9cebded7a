"""The line of requests that wait for a core, in the order they came; those behind a suspect's accounts stand aside.

Each answer frees a connection, and then the line is walked for whoever may have it. Who waits for a trial can't use
one before something is heard of that trial, so he is not asked each time: walking everybody cost the only thread of
the gateway milliseconds for each answer, just when many wait. When something was heard, all stand in one line again.
"""

from collections.abc import Iterator
from itertools import chain

from hardcore.crisis.exchange import Exchange


class Line:
    """Whoever waits and was given to no core since."""

    def __init__(self) -> None:
        self._first: dict[Exchange, None] = {}
        self._aside: dict[Exchange, None] = {}

    def __len__(self) -> int:
        """How many wait, wherever they stand."""
        return len(self._first) + len(self._aside)

    def __iter__(self) -> Iterator[Exchange]:
        """All who wait."""
        return chain(self._aside, self._first)

    def ready(self) -> list[Exchange]:
        """Who may be let go now, the oldest first."""
        return list(self._first)

    def join(self, exchange: Exchange) -> None:
        """One more waits."""
        self._first[exchange] = None

    def leave(self, exchange: Exchange) -> None:
        """It waits no longer."""
        self._first.pop(exchange, None)
        self._aside.pop(exchange, None)

    def step_aside(self, exchange: Exchange) -> None:
        """It waits for a trial: nothing else frees it."""
        del self._first[exchange]
        self._aside[exchange] = None

    def close_up(self) -> None:
        """Something was heard that may free those who stand aside."""
        if self._aside:
            together = sorted(self, key=lambda one: one.waiting_ns)
            self._first, self._aside = dict.fromkeys(together), {}
