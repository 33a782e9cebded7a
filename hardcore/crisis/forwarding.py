"""One sending of one request to a core: the answer is judged, kept whole or passed on as it comes.

An answer counts only if it names the serving epoch; one of another epoch is no answer at all. Answers to
unsafe requests are kept whole before the first byte leaves, so that a core that dies in the middle of a
201 leaves nothing half said; safe ones are kept up to a bound and then streamed. Streaming everything was
not chosen: half an answer can be neither repeated nor taken back. A page for a tab gets the crisis script here
(`injection`), before anything of it has left.
"""

import secrets
from typing import Protocol

from hardcore.crisis.burden import Share
from hardcore.crisis.exchange import PIECES_MAX, Exchange
from hardcore.crisis.heads import AnswerHead
from hardcore.crisis.holding import Life
from hardcore.crisis.injection import WITHIN_BYTES, fitted, is_page
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.upstream import Pool, UpstreamConnection

#: So much of an answer is kept without being counted: most are shorter.
UNCOUNTED_BYTES = 64 << 10


class Reader(Protocol):
    """Who is told what became of the sending."""

    def answered(self, exchange: Exchange, head: AnswerHead, body: bytes) -> None:
        """The answer is whole; `body` is all of it, or what is left of one that was begun."""

    def begun(self, exchange: Exchange, head: AnswerHead, first: bytes) -> None:
        """The answer is too long to keep: `first` is what came so far."""

    def continued(self, exchange: Exchange, data: bytes) -> None:
        """A piece of the answer that was begun."""

    def not_run(self, exchange: Exchange, pool: Pool) -> None:
        """The core says that it is leaving and did not run the request."""

    def core_lost(self, exchange: Exchange, pool: Pool) -> None:
        """No answer will come."""

    def answer_garbled(self, exchange: Exchange) -> None:
        """What came is no answer."""


class Forwarding:
    """The asker of one sending (see `upstream.Asker`)."""

    __slots__ = (
        "_connection",
        "_exchange",
        "_head",
        "_kept",
        "_limits",
        "_over",
        "_page",
        "_parts",
        "_pool",
        "_reader",
        "_size",
    )

    def __init__(
        self,
        reader: Reader,
        exchange: Exchange,
        pool: Pool,
        connection: UpstreamConnection,
        limits: GatewayLimits,
        kept: Share,
    ) -> None:
        self._reader = reader
        self._exchange = exchange
        self._pool = pool
        self._connection = connection
        self._limits = limits
        self._head: AnswerHead | None = None
        self._parts: list[bytes] = []
        self._size = 0
        self._kept = kept
        self._page = False  # what came is a page whose head is not fitted yet
        self._over = False

    def headed(self, head: AnswerHead) -> None:
        """Judge the head: whose answer is it, and was the request run at all?"""
        if head.epoch is None:
            self._stop()
            self._reader.answer_garbled(self._exchange)
        elif head.epoch != self._pool.epoch:
            self._stop()
            self._reader.core_lost(self._exchange, self._pool)
        elif head.draining and head.status == 503:
            self._stop()
            self._reader.not_run(self._exchange, self._pool)
        else:
            self._head = head
            self._page = is_page(self._exchange.head, head)
            if head.live and self._exchange.head.method == "GET":
                self._begin()

    def came(self, data: bytes) -> None:
        """Keep a piece, or pass it on."""
        if self._over:
            return
        if self._exchange.life is Life.ANSWERING:
            self._reader.continued(self._exchange, data)
            return
        self._parts.append(data)
        if len(self._parts) >= PIECES_MAX:
            self._parts = [b"".join(self._parts)]
        self._size += len(data)
        room = self._size <= UNCOUNTED_BYTES or self._kept.weighs(self._size)
        if not self._exchange.head.safe:
            if self._size > self._limits.unsafe_answer_bytes_max or not room:
                self._stop()
                self._reader.answer_garbled(self._exchange)
        elif self._size > self._kept_bytes_max() or not room:
            self._begin()

    def ended(self) -> None:
        """Pass the whole answer on."""
        if not self._over:
            self._over = True
            self._reader.answered(self._exchange, *self._take())

    def lost(self) -> None:
        """The connection ended first."""
        if not self._over:
            self.dropped()
            self._reader.core_lost(self._exchange, self._pool)

    def garbled(self) -> None:
        """The connection brought something else."""
        if not self._over:
            self.dropped()
            self._reader.answer_garbled(self._exchange)

    def dropped(self) -> None:
        """Nobody waits for it any more."""
        self._over = True
        self._kept.weighs(0)

    def flowing(self, *, on: bool) -> None:
        """Pass the core's pace on to whoever sends the body."""
        if not self._over and self._exchange.streamed:
            self._exchange.flowing = on
            self._exchange.client.flow()

    def _begin(self) -> None:
        self._reader.begun(self._exchange, *self._take())

    def _kept_bytes_max(self) -> int:
        """A page is kept until the end of its head must have come."""
        kept = self._limits.answer_buffer_bytes_max
        return max(kept, WITHIN_BYTES) if self._page else kept

    def _take(self) -> tuple[AnswerHead, bytes]:
        """What came and was not passed on yet, as the client gets it."""
        assert self._head is not None, "an answer ended that never began"
        head, body = self._head, b"".join(self._parts)
        self._parts = []
        self._kept.weighs(0)
        if not self._page:
            return head, body
        self._page = False
        return fitted(self._exchange.head, head, body, secrets.token_hex(16).encode())

    def _stop(self) -> None:
        self.dropped()
        self._connection.abandon()
