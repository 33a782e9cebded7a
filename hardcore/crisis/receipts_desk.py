"""The receipts' desk: takes promises on, tells of them, hears a person's word on them. Between requests and receipts.

What a promise is stands in `receipts`, where it is kept in `receipts_store`, how it is read in `receipts_reading` and
run in `receipts_runner`; here requests become wishes and receipts become answers. Nothing is promised before the file
was read, and no request with a key goes to a core: the key may have its receipt already, from a gateway before this
one. If the file is none of ours, nothing is promised and the rest of the gateway goes on as ever.
"""

import asyncio
import logging
from collections.abc import Callable, Coroutine, Mapping
from functools import partial
from pathlib import Path
from typing import assert_never
from urllib.parse import unquote_to_bytes

from msgspec import structs

from hardcore.crisis import pages, receipts_pages
from hardcore.crisis.dock import Dock
from hardcore.crisis.exchange import Exchange
from hardcore.crisis.heads import RequestHead
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.mishap import contained, describe
from hardcore.crisis.outlook import Outlook
from hardcore.crisis.problems import Outcome as Said
from hardcore.crisis.problems import Problem
from hardcore.crisis.receipts import (
    ASKED,
    OPEN,
    RUNNING_MAX,
    Book,
    Moment,
    Outcome,
    Receipt,
    Wish,
    Word,
    after_word,
    learn,
    letter_of,
)
from hardcore.crisis.receipts_form import (
    KeptForm,
    form_in,
    posted_bytes,
    read_kept,
    request_digest,
    wish_of_form,
    wish_of_request,
)
from hardcore.crisis.receipts_reading import Known, Reading
from hardcore.crisis.receipts_runner import Runner
from hardcore.crisis.receipts_store import Clash, Failure, ReceiptFile
from hardcore.crisis.routing import KEEP_PATH, RECEIPT_PREFIX
from hardcore.crisis.shelf import Shelf
from hardcore.host import clock

_LOG = logging.getLogger(__name__)

#: Between two looks for what is too old.
SWEEP_MS = 60_000
#: What became of storing a promise.
Kept = Receipt | Failure


def moments(awake_ns: Callable[[], int]) -> Callable[[], Moment]:
    """The clock by which promises grow old."""
    boot = clock.boot_id()
    return lambda: Moment(boot, awake_ns(), clock.together()[1].wall_ns)


class Promises:
    """All receipts of this gateway. `told` hears of each that is new or has changed."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        limits: GatewayLimits,
        outlook: Outlook,
        path: Path | None,
        dock: Dock,
        now: Callable[[], Moment],
    ) -> None:
        self.told: Callable[[Receipt], None] = lambda _: None
        self.shelf: Callable[[], Shelf] = Shelf
        self._loop = loop
        self._limits = limits
        self._dock = dock
        self._now = now
        self._file = ReceiptFile(loop, path) if path is not None else None
        self._runner: Runner | None = None
        if self._file is not None:
            self._runner = Runner(loop, limits, outlook, self._file, dock, now, self._changed)
        self.reading = Reading(loop, limits, self._file, self._took, self._soon)
        if self._runner is not None:
            self._runner.overtaken = self.reading.look_now
        self._joined: dict[str, list[Callable[[Kept], None]]] = {}  # by the key of what is being stored
        self._tasks: set[asyncio.Task[None]] = set()
        self._swept_ns = now().awake_ns
        self._leaving = False

    @property
    def _book(self) -> Book:
        assert self._runner is not None, "without a file there are no receipts"
        return self._runner.book

    @property
    def usable(self) -> bool:
        """Whether the receipts are known, and new ones can be given."""
        return self.reading.known is Known.READ

    # -- the gateway's life ----------------------------------------------------------------------------

    def start(self) -> None:
        """Read what earlier gateways promised."""
        self.reading.start()

    def _took(self, receipts: list[Receipt]) -> None:
        """All receipts as they stand in the file: at first all are new, later what another gateway has written is."""
        assert self._runner is not None
        for receipt in receipts:
            key = receipt.wish.key
            if self._free(key) and self._book.coming(key) is None and learn(self._book, receipt):
                if receipt.outcome is Outcome.WAITING:
                    self._runner.anew(key)
                if receipt.open or not receipt.seen:
                    self.told(receipt)
        self._runner.pump()

    def look(self, judged: str | None = None) -> None:
        """Something was learned about the core, or there is a verdict on, or an answer to, what is named `judged`."""
        if self._runner is None or not self.usable:
            return
        if judged is not None:
            self._runner.judged(judged)
        self._runner.look()

    def upkeep(self) -> None:
        """Now and then: see what another gateway has done, and let go of what is too old."""
        self.reading.look()
        now = self._now()
        due_ms = min(SWEEP_MS, self._limits.receipt_keep_ms)
        if self._file is None or not self.usable or now.awake_ns - self._swept_ns < due_ms * 1_000_000:
            return
        self._swept_ns = now.awake_ns
        unanswered, settled = self._book.stale(now, self._limits.receipt_keep_ms)
        for receipt in [one for one in unanswered if self._free(one.wish.key)][:RUNNING_MAX]:
            self._withdraw(receipt, lambda _: None)
        gone = [one.wish.key for one in settled]
        if gone:
            self._soon(self._forget(self._file, gone))

    async def _forget(self, file: ReceiptFile, keys: list[str]) -> None:
        if await file.forget(keys) is None:
            for key in keys:
                self._book.remove(key)

    def leave(self) -> None:
        """The gateway leaves: nothing new is run."""
        self._leaving = True
        if self._runner is not None:
            self._runner.leave()

    async def finish(self) -> None:
        """Let go of everything."""
        if self._runner is not None:
            await self._runner.finish()
        self.reading.close()
        if self._file is not None:
            self._file.close()

    def waiting(self) -> Mapping[bytes, int]:
        """How many receipts of each browser wait."""
        return self._book.waiting() if self.usable else {}

    def untold(self, browser: bytes) -> list[Receipt]:
        """What a page of this browser hears of when it opens."""
        return self._book.untold(browser) if self.usable else []

    def _changed(self, receipt: Receipt) -> None:
        self.told(receipt)
        if self._file is not None and not receipt.open and not self._book.open():
            self._soon(self._file.tidy())

    def _soon(self, deed: Coroutine[object, object, None]) -> None:
        task = self._loop.create_task(deed)
        self._tasks.add(task)
        task.add_done_callback(self._over)

    def _over(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            _LOG.error("a receipt could not be seen to: %s", describe(error))

    # -- a promise -------------------------------------------------------------------------------------

    def takes(self, exchange: Exchange) -> bool:
        """Whether a request whose time is over gets a promise."""
        head = exchange.head
        asks = head.respond_async and head.key is not None and not head.safe and not head.navigation
        if not asks or not self.usable or self._leaving or not exchange.whole or exchange.streamed:
            return False
        wish = _wish(exchange)
        known = self._known(wish.key)
        return known.digest == wish.digest if known is not None else self._book.admits(wish)

    def promise(self, exchange: Exchange, then: Callable[[Kept], None]) -> None:
        """Store a request that `takes` said yes to; `then` is told what became of that."""
        self._keep(_wish(exchange), b"".join(exchange.body), then, exchange.lost_epoch)

    def _known(self, key: str) -> Wish | None:
        receipt = self._book.get(key)
        return receipt.wish if receipt is not None else self._book.coming(key)

    def _keep(self, wish: Wish, body: bytes, then: Callable[[Kept], None], sent_epoch: int = 0) -> None:
        assert self._file is not None
        if (receipt := self._book.get(wish.key)) is not None:
            then(receipt)
        elif wish.key in self._joined:
            self._joined[wish.key].append(then)
        elif not self._book.admits(wish):
            then(Failure.REFUSED)
        else:
            self._book.expect(wish)
            self._joined[wish.key] = [then]
            self._soon(self._store(self._file, wish, body, sent_epoch))

    async def _store(self, file: ReceiptFile, wish: Wish, body: bytes, sent_epoch: int) -> None:
        assert self._runner is not None
        try:
            kept = await file.keep(wish, body, self._now(), sent_epoch)
        finally:
            self._book.expected_no_more(wish.key)
            waiting = self._joined.pop(wish.key)
        if isinstance(kept, Receipt):
            self._book.put(kept)
        for then in waiting:
            contained("telling of a promise", partial(then, kept))
        if isinstance(kept, Receipt):
            self.told(kept)
            self._runner.pump()

    # -- a request under a key that has a receipt ------------------------------------------------------

    def knows(self, exchange: Exchange) -> pages.Answer | None:
        """The answer to a request that was promised before, or whose key was, or may have been; None: it goes its way."""
        head = exchange.head
        key = _key_of(head)
        if key is None or head.safe or not exchange.whole or exchange.streamed:
            return None
        if self.reading.known is Known.UNREAD:
            return _refusal(Problem.RECEIPTS_AWAY, head, Said.UNKNOWN)
        receipt = self._book.get(key) if self.usable else None
        if receipt is None:
            return None
        if receipt.outcome is Outcome.NOT_DONE:
            return _refusal(Problem.RECEIPT_CANCELLED, head)
        if not receipt.open:
            return None  # the ledger itself knows the key
        if receipt.wish.digest != request_digest(head, exchange.body):
            return _refusal(Problem.KEY_REUSED, head)
        if letter_of(receipt) is not None:
            if self._dock.letter(receipt.wish) is None:
                assert self._runner is not None
                self._runner.look_again(
                    key
                )  # a person has let it go: what becomes of it, the ledger will say
            return None  # else the barrier says its number
        if head.navigation:
            return receipts_pages.shown_at(receipt.wish.key)
        # Its sender takes no promise for an answer: he is told where it is, and to ask again. Sent past its receipt,
        # it could be booked while a person is told that it is not.
        return receipts_pages.promised(receipt) if head.respond_async else _elsewhere(receipt, head)

    def offered(self, exchange: Exchange) -> KeptForm | None:
        """The form's wish that a recovery page may offer to keep."""
        if not self.usable or self._leaving or not exchange.whole or exchange.streamed:
            return None
        form = form_in(exchange.head, b"".join(exchange.body), pages.way_back(exchange.head) or "/")
        if form is None or posted_bytes(form) > self._limits.replay_body_bytes_max:
            return None
        return form

    # -- the paths of receipts -------------------------------------------------------------------------

    def asked(self, exchange: Exchange) -> None:
        """Answer a request for KEEP_PATH or under RECEIPT_PREFIX, as soon as the file was read."""
        if self.reading.delays(partial(self.asked, exchange)):
            return
        head = exchange.head
        if self._file is None:
            self._refuse(exchange, Problem.NOT_FOUND)
        elif not self.usable:
            self._refuse(exchange, Problem.RECEIPTS_AWAY)
        elif head.path == KEEP_PATH:
            self._asked_to_keep(exchange)
        else:
            self._asked_for(exchange, self._file)

    def _asked_for(self, exchange: Exchange, file: ReceiptFile) -> None:
        head = exchange.head
        name, _, said = head.path.removeprefix(RECEIPT_PREFIX).partition(b"/")
        receipt = self._book.get(unquote_to_bytes(name).decode("latin-1"))
        if receipt is None or (said and said not in {word.encode() for word in Word}):
            self._refuse(exchange, Problem.NOT_FOUND)
        elif head.method not in ({"POST"} if said else {"GET", "HEAD"}):
            self._refuse(exchange, Problem.METHOD_NOT_ALLOWED)
        elif said:
            self._worded_by(exchange, file, receipt, Word(said.decode()))
        else:
            self._give(exchange, self._shown(receipt, head))

    def _shown(self, receipt: Receipt, head: RequestHead) -> pages.Answer:
        sheet = self.shelf().receipt(receipt.outcome, head.accept_language) if head.navigation else None
        if sheet is None:
            return receipts_pages.as_json(receipt, self._now())
        return receipts_pages.as_page(receipt, sheet, head)

    def _worded_by(self, exchange: Exchange, file: ReceiptFile, receipt: Receipt, word: Word) -> None:
        """A person's word: on the disk first, then it counts."""
        key = receipt.wish.key
        assert self._runner is not None
        if receipt.outcome in ASKED and self._runner.runs(key):  # it is only being looked up, for a moment
            self._runner.when_over(key, partial(self.asked, exchange))
            return
        free = self._free(key)
        if self._leaving and word is not Word.SEEN:
            self._refuse(exchange, Problem.SHUTTING_DOWN)  # whoever comes next may have begun with it
            return
        if free and word is Word.CANCEL and receipt.outcome in ASKED:
            give = self._in_time(exchange, Problem.RECEIPTS_AWAY)
            self._withdraw(receipt, lambda settled: give(self._worded(exchange, settled)))
            return
        changed = after_word(receipt, word, self._now()) if free else None
        if changed is None:
            self._refuse(exchange, Problem.RECEIPT_NOT_OPEN)
            return
        give = self._in_time(exchange, Problem.RECEIPTS_AWAY)
        self._change(file, receipt, changed, lambda stored: give(self._worded(exchange, stored)))

    def _worded(self, exchange: Exchange, receipt: Receipt | None) -> pages.Answer:
        """The answer to a word; None: it could not be done now."""
        if receipt is None:
            return _refusal(Problem.RECEIPTS_AWAY, exchange.head)
        if exchange.head.navigation:
            return receipts_pages.shown_at(receipt.wish.key)
        return receipts_pages.as_json(receipt, self._now(), 202)

    def _withdraw(self, receipt: Receipt, then: Callable[[Receipt | None], None]) -> None:
        """Give a wish up: "not done" is said of it once the ledger has said that it is not there."""
        assert self._runner is not None
        self._runner.withdraw(receipt, then)

    def _free(self, key: str) -> bool:
        """Whether nobody else is about to change the receipt under a key."""
        assert self._runner is not None
        return key not in self._runner.worded and not self._runner.runs(key)

    def _change(
        self, file: ReceiptFile, was: Receipt, receipt: Receipt, then: Callable[[Receipt | None], None]
    ) -> None:
        assert self._runner is not None
        self._runner.worded.add(receipt.wish.key)
        self._soon(self._changing(file, was, receipt, then))

    async def _changing(
        self, file: ReceiptFile, was: Receipt, receipt: Receipt, then: Callable[[Receipt | None], None]
    ) -> None:
        assert self._runner is not None
        try:
            # A fact whose storing failed is stored with the word on it.
            failure = await file.change(receipt, {was.outcome} if receipt.open else OPEN | {was.outcome})
        finally:
            self._runner.worded.discard(receipt.wish.key)
        if failure is None:
            self._book.put(receipt)
            if receipt.outcome is Outcome.WAITING:
                self._runner.anew(receipt.wish.key)
            self._changed(receipt)
        elif failure is Clash.OVERTAKEN:
            self.reading.look_now()
        contained("answering a word on a receipt", partial(then, receipt if failure is None else None))
        self._runner.pump()

    def _asked_to_keep(self, exchange: Exchange) -> None:
        head = exchange.head
        if head.method != "POST":
            self._refuse(exchange, Problem.METHOD_NOT_ALLOWED)
            return
        if exchange.streamed or not exchange.whole:
            self._refuse(exchange, Problem.BODY_TOO_LARGE)
            return
        form = read_kept(head, b"".join(exchange.body))
        if form is None:
            self._refuse(exchange, Problem.NOT_KEEPABLE)
            return
        wish = wish_of_form(form, head, exchange.browser)
        known = self._known(wish.key)
        receipt = self._book.get(wish.key)
        if known is not None and known.digest != wish.digest:
            self._refuse(exchange, Problem.KEY_REUSED)
        elif receipt is not None or not self._leaving:
            give = self._in_time(exchange, Problem.PROMISE_UNKNOWN)
            self._keep(wish, form.body, lambda kept: give(_kept_answer(kept, wish.key, head)))
        else:
            self._refuse(exchange, Problem.SHUTTING_DOWN)

    def _in_time(self, exchange: Exchange, late: Problem) -> Callable[[pages.Answer], None]:
        """How to answer a request that waits for the disk: with what comes first, else with `late`."""
        waits = True

        def give(answer: pages.Answer) -> None:
            nonlocal waits
            if waits:
                waits = False
                timer.cancel()
                self._give(exchange, answer)

        wait_s = self._limits.receipt_store_ms / 1000
        timer = self._loop.call_later(wait_s, lambda: give(_refusal(late, exchange.head)))
        return give

    def _give(self, exchange: Exchange, answer: pages.Answer) -> None:
        exchange.client.answer(answer.head, answer.body)

    def _refuse(self, exchange: Exchange, problem: Problem) -> None:
        self._give(exchange, _refusal(problem, exchange.head))


#: What these say became of the request.
_SAYS = {
    Problem.KEY_REUSED: Said.NOT_DONE,
    Problem.RECEIPT_CANCELLED: Said.NOT_DONE,
    Problem.NOT_KEEPABLE: Said.NOT_DONE,
    Problem.NOT_KEPT: Said.NOT_DONE,
    Problem.BODY_TOO_LARGE: Said.NOT_DONE,
    Problem.SHUTTING_DOWN: Said.NOT_DONE,
    Problem.PROMISE_UNKNOWN: Said.UNKNOWN,
}


def _refusal(problem: Problem, head: RequestHead, said: Said | None = None) -> pages.Answer:
    if head.navigation:
        return pages.plain(problem, head)
    return pages.problem(problem, head.accept_language, said or _SAYS.get(problem))


def _elsewhere(receipt: Receipt, head: RequestHead) -> pages.Answer:
    """The answer to a copy of what was promised, where no promise was asked for: nobody knows yet, here is its receipt."""
    answer = _refusal(Problem.OUTCOME_UNKNOWN, head, Said.UNKNOWN)
    place = (b"Location", receipts_pages.address(receipt.wish.key).encode())
    return pages.Answer(structs.replace(answer.head, headers=(*answer.head.headers, place)), answer.body)


def _kept_answer(kept: Kept, key: str, head: RequestHead) -> pages.Answer:
    match kept:
        case Receipt():
            return receipts_pages.shown_at(key)
        case Failure.REFUSED:
            return _refusal(Problem.NOT_KEPT, head)
        case Failure.DOUBTFUL:
            return _refusal(Problem.PROMISE_UNKNOWN, head)
        case never:
            assert_never(never)


def _key_of(head: RequestHead) -> str | None:
    return None if head.key is None else head.key.decode("ascii")


def _wish(exchange: Exchange) -> Wish:
    return wish_of_request(
        exchange.head, exchange.body, exchange.browser, back=pages.way_back(exchange.head) or "/"
    )
