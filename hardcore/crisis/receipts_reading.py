"""Reading what earlier gateways promised: again and again until it is read, and whoever asks meanwhile waits a little.

A promise that is in the file outlives every reason why the file can't be read now, so nobody gives up: a lock ends, a
disk gets room again. Until then a request with a key may be one that a person has cancelled, and is not let through;
it waits a moment, and is then answered that nobody knows. Only a file that is none of ours holds nobody up. An older
gateway that still leaves may write a last promise: what others have written is read too, now and then.
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Coroutine
from enum import Enum, auto
from typing import assert_never

from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.mishap import contained
from hardcore.crisis.receipts import Receipt
from hardcore.crisis.receipts_store import ReceiptFile, Unread

_LOG = logging.getLogger(__name__)

#: Requests that wait for the file at a time; more are answered at once.
EARLY_MAX = 1024
#: Between two looks for what another gateway has written.
NEWS_MS = 1_000


class Known(Enum):
    """What is known of the receipts."""

    NONE = auto()  # this gateway keeps none, or can't ever know them
    UNREAD = auto()  # they are in the file, and can't be read yet
    READ = auto()


class Reading:
    """The first reading of the file, and looks for news. `took` gets all receipts: first those that are there, then
    those of each change by another gateway. `soon` runs what waits for the disk.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        limits: GatewayLimits,
        file: ReceiptFile | None,
        took: Callable[[list[Receipt]], None],
        soon: Callable[[Coroutine[object, object, None]], None],
    ) -> None:
        self.known = Known.NONE if file is None else Known.UNREAD
        self._loop = loop
        self._limits = limits
        self._file = file
        self._took = took
        self._soon = soon
        self._early: list[Callable[[], None]] | None = None if file is None else []
        self._retry: asyncio.TimerHandle | None = None
        self._told: Unread | None = None
        self._asked_s = 0.0  # when news were last asked for
        self._over = False

    def start(self) -> None:
        """Begin to read."""
        if self._file is not None:
            self._soon(self._read(self._file))
            self._loop.call_later(self._limits.receipt_store_ms / 1000, self._answer_early)

    async def _read(self, file: ReceiptFile) -> None:
        self._retry = None
        match await file.load():
            case list(receipts):
                if self._told is not None:
                    _LOG.info("the receipts are read")
                self.known = Known.READ
                self._took(receipts)
                self._answer_early()
            case Unread() as why:
                self._failed(file, why)
            case never:
                assert_never(never)

    def _failed(self, file: ReceiptFile, why: Unread) -> None:
        if why is not self._told:
            self._told = why
            _LOG.error("the receipts could not be read: nothing is promised until they are (%s)", why.name)
        self.known = Known.UNREAD if why is Unread.FOR_NOW else Known.NONE
        if self.known is Known.NONE:
            self._answer_early()
        if not self._over:
            wait_s = self._limits.receipt_pause_ms / 1000
            self._retry = self._loop.call_later(wait_s, lambda: self._soon(self._read(file)))

    def _answer_early(self) -> None:
        early, self._early = self._early or [], None
        for then in early:
            contained("answering who asked early", then)

    def delays(self, then: Callable[[], None]) -> bool:
        """Whether it is too early for somebody's question; if so, `then` is called when it is not any more."""
        if self._early is None or len(self._early) >= EARLY_MAX:
            return False
        self._early.append(then)
        return True

    def look(self) -> None:
        """Read what another gateway has written, if it is time to."""
        now_s = self._loop.time()
        if self._file is not None and self.known is Known.READ and now_s - self._asked_s >= NEWS_MS / 1000:
            self._asked_s = now_s
            self._soon(self._take(self._file.news()))

    def look_now(self) -> None:
        """Read what another gateway has written, also what was passed over because it was being run here."""
        if self._file is not None:
            self._soon(self._take(self._file.load()))

    async def _take(self, reading: Awaitable[list[Receipt] | Unread | None]) -> None:
        receipts = await reading
        if isinstance(receipts, list):
            self._took(receipts)

    def close(self) -> None:
        """Read no more."""
        self._over = True
        if self._retry is not None:
            self._retry.cancel()
