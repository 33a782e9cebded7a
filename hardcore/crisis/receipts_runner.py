"""Running receipts: once a core is released, in their order, a few at a time, each looked up before it is sent.

One course per receipt: ask the ledger for its key, decide (`receipts.after_look_up`), read its body from the disk, send
it, decide again, store the outcome, tell. A death at any point leaves it waiting, and the next course begins with the
look-up again: so it does not matter where this process or the core died. Sending receipts through the table of living
requests was not chosen: they have no client, no hold, and more than one life.
"""

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import assert_never
from urllib.parse import quote

from hardcore.crisis.heads import AnswerHead
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.mishap import describe
from hardcore.crisis.outlook import Errand, Outlook
from hardcore.crisis.receipts import (
    ODD_ANSWERS_MAX,
    Book,
    Case,
    Moment,
    Outcome,
    Receipt,
    Reply,
    Settled,
    Sign,
    Turn,
    after_look_up,
    found,
    is_old,
    read_answer,
    read_look_up,
    settle,
)
from hardcore.crisis.receipts_store import ReceiptFile
from hardcore.crisis.upstream import Pool, UpstreamConnection
from hardcore.model.phases import Face

_LOG = logging.getLogger(__name__)


@dataclass(slots=True)
class _Past:
    """What this gateway remembers of a receipt's courses. `lost_epoch`: the core that may still be running it."""

    lost_epoch: int = 0
    sent: bool = False
    odd: int = 0
    looked_epoch: int = 0  # of one that is set aside


@dataclass(frozen=True, slots=True)
class _Said:
    """A core's answer to a question of ours."""

    status: int
    body: bytes


class Runner:
    """Runs what waits. `changed` is called with each receipt that has another outcome than before."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        limits: GatewayLimits,
        outlook: Outlook,
        file: ReceiptFile,
        now: Callable[[], Moment],
        changed: Callable[[Receipt], None],
    ) -> None:
        self.book = Book(limits)
        self.worded: set[str] = set()  # keys of receipts that somebody's word changes just now
        self._loop = loop
        self._limits = limits
        self._outlook = outlook
        self._file = file
        self._now = now
        self._changed = changed
        self._running: dict[str, asyncio.Task[None]] = {}
        self._resting: dict[str, asyncio.TimerHandle] = {}
        self._past: dict[str, _Past] = {}
        self._released: tuple[int, int | None] = (0, None)
        self._leaving = False

    def look(self) -> None:
        """Something was learned about the core: whoever rested because of an older one may try again."""
        standing = self._outlook.standing
        released = (self._outlook.epoch, standing.released)
        if released != self._released:
            self._released = released
            for key in list(self._resting):
                self._resting.pop(key).cancel()
        self.pump()

    def pump(self) -> None:
        """Begin as many courses as there may be."""
        if (
            self._leaving
            or self._outlook.posture is not Face.FORWARD
            or self._outlook.standing.safe is not None
        ):
            return
        for receipt in self.book.turns(self._running, self._resting):
            self._begin(receipt)
        for receipt in self.book.open():
            if receipt.outcome is Outcome.SET_ASIDE:
                self._look_again(receipt)

    def _look_again(self, receipt: Receipt) -> None:
        """Look up one that is set aside, once in each epoch."""
        key = receipt.wish.key
        past = self._past.setdefault(key, _Past())
        if key not in self._running and key not in self.worded and past.looked_epoch < self._outlook.epoch:
            past.looked_epoch = self._outlook.epoch
            self._begin(receipt)

    def runs(self, key: str) -> bool:
        """Whether the receipt under a key is being looked up or sent just now."""
        return key in self._running

    def leave(self) -> None:
        """The gateway leaves: begin nothing more. What runs may finish."""
        self._leaving = True
        for key in list(self._resting):
            self._resting.pop(key).cancel()

    async def finish(self) -> None:
        """Let go of what still runs: the next gateway looks it up."""
        tasks = list(self._running.values())
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _begin(self, receipt: Receipt) -> None:
        key = receipt.wish.key
        task = self._loop.create_task(self._course(receipt))
        self._running[key] = task
        task.add_done_callback(lambda done: self._over(key, done))

    def _over(self, key: str, task: asyncio.Task[None]) -> None:
        self._running.pop(key, None)
        if not task.cancelled() and (error := task.exception()) is not None:
            _LOG.error("a receipt could not be run: %s", describe(error))
        receipt = self.book.get(key)
        if receipt is None or not receipt.open:
            self._past.pop(key, None)
        elif receipt.outcome is Outcome.WAITING and not self._leaving:
            wait_s = self._limits.receipt_pause_ms / 1000
            self._resting[key] = self._loop.call_later(wait_s, self._rested, key)
        self.pump()

    def _rested(self, key: str) -> None:
        self._resting.pop(key, None)
        self.pump()

    # -- one course ------------------------------------------------------------------------------------

    async def _course(self, receipt: Receipt) -> None:
        past = self._past.setdefault(receipt.wish.key, _Past())
        pool = self._outlook.pool
        if pool is None:
            return
        said = await self._ask(pool, _look_up_bytes(receipt))
        sign: Settled | Sign = Sign.SILENT if said is None else read_look_up(said.status, said.body)
        if isinstance(sign, Settled):
            assert sign.status is not None
            await self._conclude(receipt, found(sign.status, sign.answer, sent=past.sent))
            return
        if receipt.outcome is Outcome.SET_ASIDE:
            return
        case = Case(
            old=is_old(receipt.since, self._now(), self._limits.receipt_ask_after_ms),
            suspected=receipt.wish.key_hash in self._outlook.standing.suspects,
            sendable=pool is self._outlook.pool and pool.epoch > past.lost_epoch,
        )
        match after_look_up(sign, case):
            case Turn.SEND:
                await self._send(receipt, past, pool)
            case Turn.ASK:
                await self._store(replace(receipt, outcome=Outcome.ASK, changed=self._now()))
            case Turn.SET_ASIDE:
                past.looked_epoch = pool.epoch
                await self._store(replace(receipt, outcome=Outcome.SET_ASIDE, changed=self._now()))
            case Turn.WAIT:
                pass
            case never:
                assert_never(never)

    async def _send(self, receipt: Receipt, past: _Past, pool: Pool) -> None:
        body = await self._file.body(receipt.wish.key)
        if body is None:
            _LOG.error("the body of a receipt could not be read; it waits")
            return
        if self._leaving or pool is not self._outlook.pool or self._outlook.posture is not Face.FORWARD:
            return
        past.sent, before = True, past.lost_epoch
        past.lost_epoch = pool.epoch  # until it answers
        said = await self._ask(pool, _request_bytes(receipt, body))
        if said is None:
            return
        told = read_answer(said.status, said.body)
        match told:
            case Settled():
                await self._conclude(receipt, told)
            case Reply.LATER:
                past.lost_epoch = before
            case Reply.DOUBTFUL:
                pass
            case Reply.ODD:
                past.lost_epoch = before
                past.odd += 1
                if past.odd >= ODD_ANSWERS_MAX:
                    await self._conclude(receipt, Settled(Outcome.UNKNOWN, said.status))
            case never:
                assert_never(never)

    async def _conclude(self, receipt: Receipt, fact: Settled) -> None:
        await self._store(settle(receipt, fact, self._now()))

    async def _store(self, receipt: Receipt) -> None:
        """Write an outcome down and tell it.

        Where the disk does not take it, it is true all the same: the next gateway looks it up again.
        """
        failure = await self._file.change((receipt,))
        if failure is not None:
            _LOG.warning("what became of a receipt could not be stored")
        self.book.put(receipt)
        self._changed(receipt)

    # -- asking a core ---------------------------------------------------------------------------------

    async def _ask(self, pool: Pool, question: bytes) -> _Said | None:
        """The answer of the core behind `pool`; None if it gave none, or one that does not count."""
        answer: asyncio.Future[tuple[AnswerHead | None, bytes]] = self._loop.create_future()
        connection = pool.idle() or await self._dial(pool)
        if connection is None:
            self._outlook.doubt(pool)
            return None

        def told(head: AnswerHead | None, body: bytes) -> None:
            if not answer.done():
                answer.set_result((head, body))

        errand = Errand(connection, told, bytes_max=self._limits.unsafe_answer_bytes_max)
        connection.ask(errand, question, no_body=False, whole=True)
        try:
            head, body = await asyncio.wait_for(answer, self._limits.upstream_deadline_ms / 1000)
        except TimeoutError:
            connection.abandon()
            return None
        except asyncio.CancelledError:
            connection.abandon()
            raise
        return self._judged(pool, head, body)

    def _judged(self, pool: Pool, head: AnswerHead | None, body: bytes) -> _Said | None:
        if head is None or head.epoch != pool.epoch:
            self._outlook.doubt(pool)
            return None
        if head.draining and head.status == 503:
            self._outlook.leaving(pool)
            return _Said(503, b'{"outcome":"not_done"}')  # it did not run it, whatever it says of it
        self._outlook.answered(pool)
        if head.status < 300:
            self._outlook.passed_on(head)
        return _Said(head.status, body)

    async def _dial(self, pool: Pool) -> UpstreamConnection | None:
        dialled: asyncio.Future[UpstreamConnection | None] = self._loop.create_future()

        def then(connection: UpstreamConnection | None) -> None:
            if not dialled.done():
                dialled.set_result(connection)
            elif connection is not None:
                pool.give_back(connection)

        pool.dial(then)
        return await dialled


def _look_up_bytes(receipt: Receipt) -> bytes:
    wish = receipt.wish
    path = quote(wish.key, safe="")
    told = f"GET /api/ledger/commands/{path} HTTP/1.1\r\nHost: localhost\r\nX-Request-Digest: {wish.digest}\r\n\r\n"
    return told.encode()


def _request_bytes(receipt: Receipt, body: bytes) -> bytes:
    wish = receipt.wish
    parts = [f"{wish.method} ".encode(), wish.target, b" HTTP/1.1\r\nHost: ", wish.host, b"\r\n"]
    for name, value in wish.headers:
        parts += (name, b": ", value, b"\r\n")
    parts += (b"Content-Length: %d\r\n\r\n" % len(body), body)
    return b"".join(parts)
