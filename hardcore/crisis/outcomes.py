"""The list of requests that met an outage, told to the sentinel when the last of them is settled.

Every incident's report says what became of each request, so the list is kept by whoever answered them. A
second outage that begins before the first is settled joins it: its requests are the same ones, and two
half lists would each look complete.
"""

from collections import Counter
from collections.abc import Iterator

import msgspec

from hardcore.crisis.feed import Settled, outcomes_lines

#: Requests remembered of one outage. More than can wait at a time, so only refused ones are ever left out.
SETTLED_MAX = 4096


class OutageBook(msgspec.Struct):
    """`unsettled` counts requests that met the outage and have no answer yet; `open`: there is an outage.

    `totals`: how many were settled since this gateway began, by outcome.
    """

    open: bool = False
    incident: str | None = None
    unsettled: int = 0
    left_out: int = 0
    due: bool = False
    totals: Counter[str] = msgspec.field(default_factory=Counter)
    _settled: list[Settled] = msgspec.field(default_factory=list)

    def begin(self) -> None:
        """An outage begins, or goes on."""
        self.open = True

    def name(self, incident: str | None) -> None:
        """Learn which incident the outage belongs to. In peace a name is that of an earlier one."""
        if incident is not None and self.open:
            self.incident = incident

    def meet(self) -> None:
        """One more request has met the outage."""
        self.open = True
        self.unsettled += 1

    def settle(self, one: Settled) -> None:
        """One of them has its answer."""
        self.unsettled -= 1
        assert self.unsettled >= 0, "a request was settled that never met the outage"
        self.totals[one.outcome] += 1
        if len(self._settled) < SETTLED_MAX:
            self._settled.append(one)
        else:
            self.left_out += 1

    def close(self) -> None:
        """The outage is over (a core was released, or none will come): tell, once all are settled."""
        self.due = self.open

    def take(self) -> Iterator[bytes]:
        """The lines to tell the sentinel, if it is time; the book is empty afterwards."""
        if not self.due or self.unsettled:
            return iter(())
        incident, settled = self.incident, self._settled
        self.incident, self._settled, self.left_out, self.due, self.open = None, [], 0, False, False
        return outcomes_lines(incident, settled) if incident or settled else iter(())
