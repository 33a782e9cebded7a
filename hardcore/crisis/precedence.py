"""Who goes first after a release: what a browser was promised before what it sends then, and a suspect before what
touches its accounts.

A promise is older than anything its browser sends once a core serves again, and may be what the newer wish builds on
(the account it books on, the entry it reverses). So for a moment after each release an unsafe request waits for the
promises of its own browser that still wait. Only for a moment: a promise may have to wait for a person, and then the
newer wish is what somebody wants now. One line for both was not chosen: a promise that can't go on would stop a
browser for ever.

A wish that touches the accounts of a suspect waits for its verdict in the same way, because it may build on it; not
what a core has had before, which was sent beside it. It waits until no suspect is open, and at most for a while after
the guard has named them.
"""

import asyncio
from collections.abc import Callable, Collection

from hardcore.crisis.exchange import Exchange
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.outlook import Outlook
from hardcore.crisis.receipts_desk import Promises
from hardcore.crisis.touching import Accounts

#: A timer may ring a little before its time.
_EARLY_MS = 10


class Precedence:
    """`freed` is called when somebody may go on."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        limits: GatewayLimits,
        outlook: Outlook,
        promises: Promises,
        now_ns: Callable[[], int],
        freed: Callable[[], None],
    ) -> None:
        self.freed = freed
        self._loop = loop
        self._first_ms = limits.receipts_first_ms
        self._outlook = outlook
        self._promises = promises
        self._now_ns = now_ns
        self._epoch = 0
        self._until_ns = 0
        self._account_hold_ms = limits.account_hold_ms
        self._accounts = Accounts()
        self._accounts_until_ns = 0

    def released(self) -> None:
        """A core serves: if it is another one, its first moment begins."""
        if self._epoch != self._outlook.epoch:
            self._epoch = self._outlook.epoch
            self._until_ns = self._now_ns() + self._first_ms * 1_000_000
            self._loop.call_later((self._first_ms + _EARLY_MS) / 1000, self.freed)

    def ahead(self) -> Collection[bytes]:
        """Browsers whose promises go first now. While a core only reads, none is kept."""
        is_time = self._now_ns() < self._until_ns and self._outlook.standing.safe is None
        return self._promises.waiting() if is_time else ()

    def suspected(self) -> None:
        """The guard has named suspects, or the last of them has its verdict."""
        accounts = frozenset(self._outlook.standing.account_ids)
        before = self._accounts.names
        if accounts != before:
            self._accounts = Accounts(accounts)
        if not accounts <= before:
            self._accounts_until_ns = self._now_ns() + self._account_hold_ms * 1_000_000
            self._loop.call_later((self._account_hold_ms + _EARLY_MS) / 1000, self.freed)
        self.freed()

    def lets(self, exchange: Exchange, ahead: Collection[bytes] | None = None) -> bool:
        """Whether nothing goes before this request. `ahead`: as `ahead` says it, if that is known."""
        if exchange.head.safe or exchange.cleared:
            return True
        if exchange.browser is not None and exchange.browser in (self.ahead() if ahead is None else ahead):
            return False
        return not self.touches(exchange)

    def touches(self, exchange: Exchange) -> bool:
        """Whether it waits for a trial, because it names an account of a suspect. One that was cleared never does."""
        if exchange.head.safe or exchange.cleared:
            return False
        if not self._accounts.names or self._now_ns() >= self._accounts_until_ns:
            return False
        head, body = exchange.head, b"" if exchange.streamed else b"".join(exchange.body)
        return self._accounts.named_in(head.path, head.headers, body)
