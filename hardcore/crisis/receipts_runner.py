"""Running receipts: once a core is released, in their order, a few at a time, each looked up before it is sent.

One course per receipt: ask the ledger for its key, decide (`receipts.after_look_up`), read its body from the disk, send
it, decide again, store the outcome, tell. A death at any point leaves it waiting, and the next course begins with the
look-up again: so it does not matter where this process or the core died. Before it is sent it is claimed in the file:
which core has it is known to the next gateway, and none sends what another has settled. What can't be done now rests,
longer each time, and is old one day: then a person is asked. Sending receipts through the table of living
requests was not chosen: they have no client, no hold, and more than one life.
"""

import asyncio
import logging
from collections.abc import Callable, Coroutine
from functools import partial
from typing import assert_never
from urllib.parse import quote

import msgspec
from msgspec import structs

from hardcore.crisis.dock import Dock
from hardcore.crisis.heads import AnswerHead
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.mishap import contained, describe
from hardcore.crisis.outlook import Errand, Outlook
from hardcore.crisis.receipts import (
    ASKED,
    ODD_ANSWERS_MAX,
    OPEN,
    RUNNING_MAX,
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
    after_withdrawal,
    found,
    is_old,
    read_answer,
    read_look_up,
    set_aside,
    settle,
    value_in,
)
from hardcore.crisis.receipts_store import Clash, Failure, ReceiptFile
from hardcore.crisis.upstream import Pool, UpstreamConnection
from hardcore.model.phases import Face

_LOG = logging.getLogger(__name__)


class _Said(msgspec.Struct, frozen=True):
    """A core's answer to a question of ours. `committed`: it names a commit."""

    status: int
    body: bytes
    committed: bool = False


#: The longest rest is so many times (as a power of two) the first one.
RESTS_DOUBLE_MAX = 6


class _Past(msgspec.Struct):
    """What this gateway remembers of a receipt's courses. `lost_ns`: since when no connection of ours carries it
    (awake time); `answered_epoch`: the last core that has given its word on it, or that it never reached; `barred_epoch`: a core
    that itself does not know; `turned`: a no of which only the ledger can say whether it was meant for the wish.
    """

    lost_ns: int
    answered_epoch: int = 0
    barred_epoch: int = 0
    sent: bool = False
    odd: int = 0
    turned: _Said | None = None
    rests: int = 0
    looked_epoch: int = 0  # of one that waits for a person
    allowed: bool = False  # a person has let it run


class Runner:
    """Runs what waits. `changed` is called with each receipt that has another outcome than before."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        limits: GatewayLimits,
        outlook: Outlook,
        file: ReceiptFile,
        dock: Dock,
        now: Callable[[], Moment],
        changed: Callable[[Receipt], None],
    ) -> None:
        self.book = Book(limits)
        self.overtaken: Callable[[], None] = lambda: None  # hears that another gateway has changed a receipt
        self.worded: set[str] = set()  # keys of receipts that somebody's word changes just now
        self._loop = loop
        self._limits = limits
        self._outlook = outlook
        self._file = file
        self._dock = dock
        self._now = now
        self._changed = changed
        self._running: dict[str, asyncio.Task[None]] = {}
        self._resting: dict[str, asyncio.TimerHandle] = {}
        self._past: dict[str, _Past] = {}
        self._released: tuple[int, int | None, str | None] = (0, None, None)
        self._leaving = False

    def look(self) -> None:
        """Something was learned about the core: whoever rested because of an older one may try again."""
        standing = self._outlook.standing
        released = (self._outlook.epoch, standing.released, standing.safe)
        if released != self._released:
            self._released = released
            for key in list(self._resting):
                self._resting.pop(key).cancel()
            for past in self._past.values():
                past.rests = 0
        self.pump()

    def pump(self) -> None:
        """Begin as many courses as there may be."""
        if self._leaving or not self._serves():
            return
        for receipt in self.book.turns(self._running, self._resting):
            self._begin(receipt.wish.key, self._course(receipt))
        for receipt in self.book.open():
            if len(self._running) >= RUNNING_MAX:
                return
            if receipt.outcome in ASKED and self._is_new_to_it(receipt):
                self._begin(receipt.wish.key, self._course(receipt))

    def _serves(self) -> bool:
        """Whether a core is there that takes what changes something, and knows what it finds."""
        return self._outlook.posture is Face.FORWARD and self._outlook.standing.safe is None

    def _is_new_to_it(self, receipt: Receipt) -> bool:
        """Whether the serving core was not asked yet about one that waits for a person."""
        key = receipt.wish.key
        free = key not in self._running and key not in self._resting and key not in self.worded
        return free and self._past_of(key).looked_epoch < self._outlook.epoch

    def _past_of(self, key: str) -> _Past:
        if key not in self._past:
            self._past[key] = _Past(self._now().awake_ns)
        return self._past[key]

    def anew(self, key: str) -> None:
        """A person lets it run: what it met before counts no more."""
        past = self._past_of(key)
        past.odd, past.turned, past.rests, past.allowed = 0, None, 0, True
        if key in self._resting:
            self._resting.pop(key).cancel()

    def judged(self, name: str) -> None:
        """There is a verdict on a suspect, or one that was named got its answer: if it was promised, it waits no more."""
        for receipt in [one for one in self.book.open() if one.wish.key_hash == name]:
            past = self._past_of(receipt.wish.key)
            past.rests, past.looked_epoch = 0, 0
            if receipt.wish.key in self._resting:
                self._resting.pop(receipt.wish.key).cancel()
        self.pump()

    def look_again(self, key: str) -> None:
        """What was set aside may be done now by somebody else's hand: ask the ledger in a moment."""
        self._past_of(key).looked_epoch = 0
        if key not in self._resting and key not in self._running:
            wait_s = self._limits.receipt_pause_ms / 1000
            self._resting[key] = self._loop.call_later(wait_s, self._rested, key)

    def runs(self, key: str) -> bool:
        """Whether the receipt under a key is being looked up or sent just now."""
        return key in self._running

    def when_over(self, key: str, then: Callable[[], None]) -> None:
        """Call `then` when the receipt under a key is not being looked up or sent any more."""
        self._running[key].add_done_callback(lambda _: then())

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

    def _begin(self, key: str, course: Coroutine[object, object, None]) -> None:
        task = self._loop.create_task(course)
        self._running[key] = task
        task.add_done_callback(lambda done: self._over(key, done))

    def _over(self, key: str, task: asyncio.Task[None]) -> None:
        self._running.pop(key, None)
        if not task.cancelled() and (error := task.exception()) is not None:
            _LOG.error("a receipt could not be run: %s", describe(error))
        receipt = self.book.get(key)
        if receipt is None or not receipt.open:
            self._past.pop(key, None)
        elif not self._leaving:
            past = self._past_of(key)
            wait_s = self._limits.receipt_pause_ms / 1000 * 2 ** min(past.rests, RESTS_DOUBLE_MAX)
            past.rests += 1
            self._resting[key] = self._loop.call_later(wait_s, self._rested, key)
        self.pump()

    def _rested(self, key: str) -> None:
        self._resting.pop(key, None)
        self.pump()

    # -- one course ------------------------------------------------------------------------------------

    async def _course(self, receipt: Receipt) -> None:
        past = self._past_of(receipt.wish.key)
        pool = self._outlook.pool
        if pool is None:
            return
        sign = await self._looked_up(pool, receipt, past)
        if isinstance(sign, Settled):
            await self._conclude(receipt, sign)
            return
        if receipt.outcome in ASKED:
            return
        await (
            self._dock.current()
        )  # it may be set aside by a rule that was written just before this core came
        case = Case(
            old=is_old(receipt.since, self._now(), self._limits.receipt_ask_after_ms),
            suspected=receipt.wish.key_hash in self._outlook.standing.suspects,
            sendable=pool is self._outlook.pool and self._is_let_go(receipt, past, pool),
            weary=past.turned is not None or past.odd >= ODD_ANSWERS_MAX,
            aside=self._dock.letter(receipt.wish) is not None,
            dropped=self._dock.dropped(receipt.wish.key_hash) and not past.allowed,
        )
        match after_look_up(sign, case):
            case Turn.SEND:
                await self._send(receipt, past, pool)
            case Turn.ASK:
                await self._put_to_a_person(self._asked(receipt, past.turned))
            case Turn.SET_ASIDE:
                letter = self._dock.letter(receipt.wish) or ""
                await self._put_to_a_person(set_aside(receipt, letter, self._now()))
            case Turn.TRY:
                body = await self._file.body(receipt.wish.key)
                if body is not None:
                    self._dock.try_promised(receipt.wish, body)
            case Turn.WAIT:
                pass
            case never:
                assert_never(never)

    async def _looked_up(self, pool: Pool, receipt: Receipt, past: _Past) -> Settled | Sign:
        said = await self._ask(pool, _look_up_bytes(receipt))
        sign = Sign.SILENT if said is None else read_look_up(said.status, said.body)
        if sign is not Sign.SILENT:
            past.looked_epoch = pool.epoch
        if isinstance(sign, Settled):
            assert sign.status is not None
            return found(sign.status, sign.answer, sent=past.sent)
        return sign

    def _is_let_go(self, receipt: Receipt, past: _Past, pool: Pool) -> bool:
        """Whether no core is running it: a later one serves, or the one that had it has given its word.

        A core that hung up on it and lives is believed once as much time has gone as any request may take: the look-up
        stands behind all that was submitted to it. Waiting for its death would be waiting for months.
        """
        if pool.epoch > receipt.sent_epoch or past.answered_epoch == receipt.sent_epoch:
            return True
        quiet_ms = (self._now().awake_ns - past.lost_ns) / 1_000_000
        return past.barred_epoch != pool.epoch and quiet_ms >= self._limits.upstream_deadline_ms

    async def _send(self, receipt: Receipt, past: _Past, pool: Pool) -> None:
        body = await self._file.body(receipt.wish.key)
        if body is None:
            _LOG.error("the body of a receipt could not be read; it waits")
            return
        claimed = structs.replace(receipt, sent_epoch=pool.epoch)
        failure = await self._file.change(claimed, {Outcome.WAITING})
        if failure is not None:
            if failure is Clash.OVERTAKEN:
                self.overtaken()
            return
        self.book.put(claimed)
        if self._leaving or pool is not self._outlook.pool or self._outlook.posture is not Face.FORWARD:
            past.answered_epoch = claimed.sent_epoch  # claimed, and never sent: that core has none of it
            return
        past.sent = True
        try:
            said = await self._ask(pool, _request_bytes(receipt, body))
        finally:
            past.lost_ns = self._now().awake_ns
        if said is not None:
            await self._judge(claimed, past, said)

    async def _judge(self, receipt: Receipt, past: _Past, said: _Said) -> None:
        """What the answer to the request itself leads to."""
        told = read_answer(said.status, said.body, committed=said.committed)
        if told is Reply.DOUBTFUL:
            if (
                said.status == 503
            ):  # its COMMIT failed: it is ending, and what it finds meanwhile may not last
                past.barred_epoch = receipt.sent_epoch
            return
        past.answered_epoch = receipt.sent_epoch
        match told:
            case Settled():
                await self._conclude(receipt, told)
            case Reply.CHECK:
                past.turned, past.rests = said, 0  # soon
            case Reply.ODD:
                past.odd += 1
            case Reply.LATER:
                pass
            case never:
                assert_never(never)

    async def _conclude(self, receipt: Receipt, fact: Settled) -> Receipt:
        """Write down what the ledger says, and tell it.

        Where the disk does not take it, it is true all the same: the next gateway looks it up again.
        """
        settled = settle(receipt, fact, self._now())
        if await self._file.change(settled, OPEN) in {Failure.REFUSED, Failure.DOUBTFUL}:
            _LOG.warning("what became of a receipt could not be stored")
        self._tell(settled)
        return settled

    def _asked(self, receipt: Receipt, turned: _Said | None) -> Receipt:
        asked = structs.replace(receipt, outcome=Outcome.ASK, changed=self._now())
        if turned is not None:
            asked = structs.replace(asked, status=turned.status, answer=value_in(turned.body))
        return asked

    async def _put_to_a_person(self, asked: Receipt) -> None:
        """Ask a person, or tell him that it is set aside. Where the disk does not take that, it waits on."""
        failure = await self._file.change(asked, {Outcome.WAITING})
        if failure is None:
            self._tell(asked)
        elif failure is Clash.OVERTAKEN:
            self.overtaken()

    def _tell(self, receipt: Receipt) -> None:
        self.book.put(receipt)
        self._changed(receipt)

    # -- nobody wants it any more ----------------------------------------------------------------------

    def withdraw(self, receipt: Receipt, then: Callable[[Receipt | None], None]) -> None:
        """Look a receipt up that waits for a person: `then` gets its outcome, or None if nobody can say it now."""
        assert receipt.outcome in ASKED, "what may be at the core is not taken back"
        self._begin(receipt.wish.key, self._withdrawal(receipt, then))

    async def _withdrawal(self, receipt: Receipt, then: Callable[[Receipt | None], None]) -> None:
        settled = None
        try:
            settled = await self._withdrawn(receipt)
        finally:
            contained("answering who withdrew a wish", partial(then, settled))

    async def _withdrawn(self, receipt: Receipt) -> Receipt | None:
        pool = self._outlook.pool
        if pool is None or not self._serves():
            return None
        past = self._past_of(receipt.wish.key)
        sign = await self._looked_up(pool, receipt, past)
        if isinstance(sign, Settled):
            return await self._conclude(receipt, sign)
        certain = pool is self._outlook.pool and self._is_let_go(receipt, past, pool)
        in_parts = receipt.sent_epoch > 0 and receipt.wish.in_parts
        fact = after_withdrawal(sign, in_parts=in_parts, certain=certain)
        if fact is None:
            return None
        settled = settle(receipt, fact, self._now())
        failure = await self._file.change(settled, {receipt.outcome})
        if failure is not None:
            if failure is Clash.OVERTAKEN:
                self.overtaken()
            return None
        self._tell(settled)
        return settled

    # -- asking a core ---------------------------------------------------------------------------------

    async def _ask(self, pool: Pool, question: bytes) -> _Said | None:
        """The answer of the core behind `pool`; None if it gave none, or one that does not count."""
        answer: asyncio.Future[tuple[AnswerHead | None, bytes]] = self._loop.create_future()
        connection = pool.idle() or await self._dial(pool)
        if connection is None or not connection.usable:  # it may have ended before we were told that it began
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
        if head.status < 400:
            self._outlook.passed_on(head)
        return _Said(head.status, body, head.commit is not None)

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
