"""Moving requests along the table in `holding`, and doing what the table says.

Every step of a request is one call of `move`: the table gives the deed, the deed is done here, and the
lists of who waits and who is at the core follow from it. Clients, cores and the feed only cause steps
(`desk`, `returns`, `outlook`); none of them changes a request by itself.
"""

import asyncio
import logging
from collections import Counter
from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path
from typing import assert_never

from hardcore.crisis import pages
from hardcore.crisis.barrier import Barrier
from hardcore.crisis.cases import Cases
from hardcore.crisis.dock import Dock
from hardcore.crisis.exchange import Exchange
from hardcore.crisis.feed import Settled, Teller, overdue_line
from hardcore.crisis.holding import (
    OVER,
    TABLE,
    WAITING,
    Deed,
    Life,
    Trigger,
    WaitingRoom,
    after_release,
    hold_limit_ms,
)
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.line import Line
from hardcore.crisis.mishap import describe
from hardcore.crisis.outcomes import OutageBook
from hardcore.crisis.outlook import Outlook, Ties
from hardcore.crisis.plight import cover
from hardcore.crisis.precedence import Precedence
from hardcore.crisis.problems import STATUS, Outcome, Problem
from hardcore.crisis.quarantine import SetAside
from hardcore.crisis.receipts import Receipt
from hardcore.crisis.receipts_desk import Kept, Promises, moments
from hardcore.crisis.receipts_pages import promised
from hardcore.crisis.receipts_store import Failure
from hardcore.crisis.recording import STAGES
from hardcore.crisis.returns import Returns
from hardcore.crisis.routing import Route, route
from hardcore.crisis.sending import Courier
from hardcore.crisis.shelf import Shelf
from hardcore.crisis.telling import Told, of_a_refused, told_for, words
from hardcore.model.phases import Face

_LOG = logging.getLogger(__name__)

#: Problems that say that nothing was done, by what made us turn a request away.
TURNED_AWAY = {
    Route.REFUSE: Problem.NOT_SERVING,
    Route.CLOSE: Problem.SHUTTING_DOWN,
    Route.HOLD: Problem.RECOVERING,
    Route.FORWARD: Problem.TOO_BUSY,
}
#: Problems after which the connection ends: nothing more will be answered on it, or its bytes are in doubt.
_CLOSES = frozenset(
    {Problem.SHUTTING_DOWN, Problem.BAD_REQUEST, Problem.REQUEST_TIMEOUT, Problem.BODY_TOO_LARGE}
)
#: Lives in which a core has it, or may have it, and nobody has asked.
_AT_A_CORE = frozenset({Life.FORWARDED, Life.LOST, Life.ASKED})


class Moves:
    """Holds every living request."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        limits: GatewayLimits,
        teller: Teller,
        now_ns: Callable[[], int],
        receipts: Path | None = None,
        state: Path | None = None,
    ) -> None:
        self.leaving = False
        self.shelf = Shelf()  # empty until it was rendered
        self.room = WaitingRoom(limits)
        self.book = OutageBook()
        self.outlook = Outlook(loop, limits, Ties(self._changed, self._pump_soon, teller, now_ns))
        self.courier = Courier(self.outlook, limits, Returns(self, self.outlook, limits, self._absent))
        self.barrier = Barrier(loop, state)
        self.outlook.ruled = self.barrier.hit
        self.barrier.renewed = self._ruled_anew
        folder = state / "cases" if state is not None else None
        cases = partial(Cases, loop, folder)
        self.dock = Dock(self.outlook, self.barrier, cases, teller, now_ns, self.step)
        self.promises = Promises(loop, limits, self.outlook, receipts, self.dock, moments(now_ns))
        self.precedence = Precedence(loop, limits, self.outlook, self.promises, now_ns, self._look_again)
        self._loop = loop
        self._limits = limits
        self._teller = teller
        self._now_ns = now_ns
        self._held = Line()
        self._lost: dict[Exchange, None] = {}
        self._at_core: dict[Exchange, None] = {}
        self._keeping: dict[Exchange, None] = {}  # their promise is being stored
        self._pump_due = False

    def way(self, path: bytes) -> Route:
        """Where a request for this path goes now."""
        return route(path, self.outlook.posture, leaving=self.leaving)

    def counts(self) -> tuple[int, int]:
        """Requests that wait here, and requests that are at the core."""
        waiting = len(self._held) + len(self._lost) + len(self._keeping) + len(self.dock.waiting())
        return waiting, len(self._at_core)

    def waiting(self) -> dict[bytes, int]:
        """How many requests of each browser wait here."""
        here = (*self._held, *self._lost, *self._keeping, *self.dock.waiting())
        return Counter(one.browser for one in here if one.browser is not None)

    def leave(self) -> None:
        """The gateway is being stopped: whoever waits is answered now, what is at the core may finish."""
        self.leaving = True
        self.promises.leave()
        self._turn_all_away(Problem.SHUTTING_DOWN)

    def give_up(self) -> None:
        """The time to finish is over: answer whoever is still at the core with what is true."""
        for exchange in [*self._at_core, *self._keeping]:
            if exchange.life not in OVER:
                self.step(exchange, Trigger.TURN_AWAY)
        self._flush_book(over=True)
        self.outlook.close()

    # -- the outlook changed ---------------------------------------------------------------------------

    def _changed(self) -> None:
        match self.outlook.posture:
            case Face.FORWARD:
                self.precedence.released()
                self._held.close_up()
                self._pump()
                self._flush_book(over=True)
            case Face.REFUSE:
                self._turn_all_away(Problem.NOT_SERVING)
                self._flush_book(over=True)
            case Face.CLOSED:
                self._turn_all_away(Problem.SHUTTING_DOWN)
                self._flush_book(over=True)
            case Face.HOLD:
                self.book.begin()

    def _turn_all_away(self, problem: Problem) -> None:
        for exchange in [*self._lost, *self._held, *self.dock.waiting()]:
            if exchange.life in WAITING:
                exchange.fault = problem
                self.step(exchange, Trigger.TURN_AWAY)

    def _pump_soon(self) -> None:
        if not self._pump_due and (self._held or self._lost):
            self._pump_due = True
            self._loop.call_soon(self._pump)

    def _pump(self) -> None:
        """Give the core what waits for it, the lost ones first, as far as there are connections."""
        self._pump_due = False
        if self.outlook.posture is not Face.FORWARD:
            return
        for exchange in list(self._lost):
            newer = self.outlook.epoch > exchange.lost_epoch
            if exchange.life is Life.LOST and (newer or not exchange.rests):
                if not self.core_has_room():
                    return
                suspected = self.dock.suspects(exchange) or self.barrier.bars(exchange)
                self.step(exchange, after_release(exchange.plea(), suspected=suspected, newer=newer))
        ahead = self.precedence.ahead()
        for exchange in self._held.ready():
            if not self.core_has_room():
                return
            if exchange.life is Life.HELD:
                self._let_go(exchange, ahead)

    def _let_go(self, exchange: Exchange, ahead: Collection[bytes]) -> None:
        """Give the core a request that waits, unless something has been said of it or goes before it."""
        if (said := self._said_of(exchange)) is not None:
            self.step(exchange, said)
        elif self.precedence.lets(exchange, ahead):
            self.step(exchange, Trigger.PASS)
        elif self.precedence.touches(exchange):
            self._held.step_aside(exchange)

    def _said_of(self, exchange: Exchange) -> Trigger | None:
        """What becomes of a request that waits, if a rule or the guard has named it. It may be done already, so the
        ledger is asked before it is refused, wherever it can be.
        """
        if self.barrier.bars(exchange):
            return Trigger.ASK if exchange.askable else Trigger.BARRED
        return Trigger.ASK if self.dock.suspects(exchange) else None

    def _absent(self, exchange: Exchange) -> Trigger:
        """What becomes of a request that the ledger does not have, and never will by itself."""
        if self.dock.accuses(exchange):
            return Trigger.SUSPECTED
        if self.barrier.bars(exchange):
            return Trigger.BARRED
        # A rule may have gone while its request was looked up: whoever took it away wants that it runs.
        return Trigger.ABSENT if exchange.sends or exchange.spent else Trigger.LET_GO

    def _ruled_anew(self) -> None:
        """Other rules are in force: whoever waits may be named by one."""
        self._look_again()
        self.promises.look()

    def _look_again(self) -> None:
        """Something was said that may free, or name, whoever waits."""
        self._held.close_up()
        self._pump_soon()

    def core_has_room(self) -> bool:
        """Whether the serving core can be given one more request now."""
        pool = self.outlook.pool
        return self.outlook.posture is Face.FORWARD and pool is not None and pool.room

    def step(self, exchange: Exchange, trigger: Trigger, answer: pages.Answer | None = None) -> None:
        """Move a request; a bug of ours with it ends its connection and reaches nobody else."""
        try:
            self.move(exchange, trigger, answer)
        except Exception as error:  # noqa: BLE001 - whatever it was, it belongs to this request alone
            _LOG.error("a request could not be moved by %s: %s", trigger, describe(error))
            self._abandon(exchange)
            exchange.client.cut()

    # -- one step along the table ----------------------------------------------------------------------

    def move(self, exchange: Exchange, trigger: Trigger, answer: pages.Answer | None = None) -> None:
        """Take one step of the table; `answer` comes with those triggers that bring one."""
        before = exchange.life
        exchange.life, deed = TABLE[before, trigger]
        assert deed is not Deed.NEVER, f"{trigger} cannot happen to a request in {before}"
        exchange.place.stands(STAGES[exchange.life])
        self._unlist(exchange)
        match deed:
            case Deed.SEND:
                self._send(exchange)
            case Deed.WAIT:
                self._wait(exchange)
            case Deed.REMEMBER:
                self._remember(exchange)
            case Deed.ASK_LATER:
                self._ask_later(exchange)
            case Deed.LOOK_UP:
                self._look_up(exchange)
            case Deed.STORE:
                self._store(exchange)
            case Deed.TRY:
                self.dock.enter(exchange)
                # Of a form too: its page stands until it is answered.
                limit_ms = hold_limit_ms(self._limits, navigation=False)
                if exchange.life is Life.ON_TRIAL:
                    self._limit_from(exchange, exchange.lost_ns or exchange.waiting_ns, limit_ms)
            case Deed.FREE:
                self._held.join(exchange)
                self._pump_soon()
            case Deed.SAY_SET_ASIDE:
                self._say_barred(exchange, looked_up=before in {Life.ASKED, Life.ON_TRIAL})
            case Deed.SAY_PROMISED:
                assert answer is not None
                self._settle(exchange, "promised", answer.head.status)
                exchange.client.answer(answer.head, answer.body)
            case Deed.BEGIN:
                assert answer is not None
                self._at_core[exchange] = None
                exchange.answer_status = answer.head.status
                exchange.client.limit.set(self._limits.upstream_deadline_ms)
                exchange.client.begin(answer.head, answer.body)
            case Deed.PASS_ON | Deed.SAY_STORED:
                assert answer is not None
                if deed is Deed.SAY_STORED:
                    self.dock.settled(exchange)
                word = "done" if deed is Deed.SAY_STORED else _how(exchange)
                self._settle(exchange, word, answer.head.status)
                if deed is Deed.SAY_STORED and exchange.head.navigation:
                    answer = pages.stored_for_tab(answer, exchange.head)
                exchange.client.answer(answer.head, answer.body)
                if exchange.barred:
                    self.promises.look(
                        exchange.name
                    )  # what was promised of it may be set aside, and is done now
            case Deed.FINISH:
                self._settle(exchange, _how(exchange), exchange.answer_status)
                exchange.client.end()
            case Deed.CUT:
                self._settle(exchange, "unknown", exchange.answer_status)
                exchange.client.cut()
            case Deed.NOTHING | Deed.NEVER:
                pass
            case _:
                if before in _AT_A_CORE:
                    self.dock.keep(exchange)
                self._tell_overdue(exchange, deed)
                if deed is Deed.SAY_UNKNOWN:
                    self._meet(exchange, outage=True)  # whatever the feed says: a core died under it
                self._say(exchange, told_for(deed, exchange, early=before is Life.ARRIVED))

    # -- deeds -----------------------------------------------------------------------------------------

    def _send(self, exchange: Exchange) -> None:
        self._leave_room(exchange)
        self._at_core[exchange] = None
        exchange.client.limit.set(self._limits.upstream_deadline_ms)
        self.courier.send(exchange)

    def _tell_overdue(self, exchange: Exchange, deed: Deed) -> None:
        """Tell the guard of what a core does not answer: it may be the first that anybody sees of its trouble."""
        if deed is not Deed.SAY_LATE:
            return
        exchange.place.overdue()
        age_ms = (self._now_ns() - exchange.arrived_ns) // 1_000_000
        path = exchange.head.path.decode("ascii", "replace")
        self._teller.say(overdue_line(path, self.outlook.epoch, age_ms))

    def _look_up(self, exchange: Exchange) -> None:
        self._lost[exchange] = None  # it still waits here, and its limit still runs
        self.courier.look_up(exchange)

    def time_is_over(self, exchange: Exchange) -> None:
        """A request waits, or runs, for too long: whoever takes a promise gets one, if there is one to give."""
        if exchange.life is Life.HELD and self.core_has_room() and self._said_of(exchange) is None:
            self.move(exchange, Trigger.PASS)  # it has let its browser's promises go first for long enough
            return
        promised = exchange.life in WAITING and self.promises.takes(exchange)
        self.move(exchange, Trigger.PROMISE if promised else Trigger.LIMIT)

    def _store(self, exchange: Exchange) -> None:
        self._keeping[exchange] = None
        connection, exchange.upstream, exchange.dial = exchange.upstream, None, None
        if connection is not None:
            connection.abandon()  # it was being looked up; the promise begins with that anew
        exchange.client.limit.set(self._limits.receipt_store_ms)
        self.promises.promise(exchange, lambda kept: self._stored(exchange, kept))

    def _stored(self, exchange: Exchange, kept: Kept) -> None:
        match kept:
            case Receipt():
                self.step(exchange, Trigger.KEPT, promised(kept))
            case Failure.REFUSED:
                self.step(exchange, Trigger.NOT_KEPT)
            case Failure.DOUBTFUL:
                self.step(exchange, Trigger.DOUBTFUL)
            case never:
                assert_never(never)

    def keep(self, exchange: Exchange) -> None:
        """Let a request wait, if there is room for one more."""
        problem = self.room.enter(exchange.browser)
        if problem is not None:
            self.turn_away(exchange, problem)
            return
        exchange.in_room = True
        self.move(exchange, Trigger.KEEP)

    def _wait(self, exchange: Exchange) -> None:
        if self._nobody_comes(exchange):
            return
        if not exchange.in_room:  # it comes back from a core that did not run it
            problem = self.room.enter(exchange.browser)
            if problem is not None:
                self.turn_away(exchange, problem)
                return
            exchange.in_room = True
        self._meet(exchange, outage=self.outlook.posture is not Face.FORWARD)
        self._held.join(exchange)
        exchange.waiting_ns = exchange.waiting_ns or self._now_ns()
        limit_ms = hold_limit_ms(self._limits, navigation=exchange.head.navigation)
        self._limit_from(exchange, exchange.waiting_ns, limit_ms)
        self._pump_soon()  # the next core may serve already: one that was leaving is heard for a while

    def _remember(self, exchange: Exchange) -> None:
        if self._nobody_comes(exchange):
            return
        self._meet(exchange, outage=True)
        self._lost[exchange] = None
        exchange.upstream = None
        exchange.lost_ns = exchange.lost_ns or self._now_ns()
        limit_ms = hold_limit_ms(self._limits, navigation=exchange.head.navigation)
        self._limit_from(exchange, exchange.lost_ns, limit_ms)
        self._pump_soon()  # another core may serve already, or this one again

    def _ask_later(self, exchange: Exchange) -> None:
        """The core that had it serves on and does not know of it (yet): whoever comes next, or a while, may tell."""
        self._lost[exchange] = None
        exchange.rests = True
        self._loop.call_later(self._limits.ask_again_ms / 1000, self._rested, exchange)

    def _rested(self, exchange: Exchange) -> None:
        exchange.rests = False
        self._pump_soon()

    def _limit_from(self, exchange: Exchange, since_ns: int, limit_ms: int) -> None:
        gone_ms = (self._now_ns() - since_ns) / 1_000_000
        exchange.client.limit.set(max(0.0, limit_ms - gone_ms))

    def _nobody_comes(self, exchange: Exchange) -> bool:
        """Whether waiting is pointless; if so, the request is answered."""
        way = self.way(exchange.head.path)
        if way in {Route.REFUSE, Route.CLOSE}:
            self.turn_away(exchange, TURNED_AWAY[way])
            return True
        return False

    def turn_away(self, exchange: Exchange, problem: Problem) -> None:
        """Answer a request that waits, or would have to, with `problem`."""
        self._meet(exchange, outage=self.outlook.posture is not Face.FORWARD)
        exchange.fault = problem
        self.move(exchange, Trigger.TURN_AWAY)

    def _meet(self, exchange: Exchange, *, outage: bool) -> None:
        if outage and not exchange.met_outage:
            exchange.met_outage = True
            self.book.meet()

    def _say(self, exchange: Exchange, told: Told) -> None:
        offers = told.offers or told.outcome is Outcome.NOT_DONE
        form = self.promises.offered(exchange) if offers else None
        self._settle(exchange, told.word or told.outcome, STATUS[told.problem])
        page = cover(
            told.problem,
            told.outcome,
            self.outlook.posture,
            safe=exchange.head.safe,
            planned=self.outlook.standing.planned,
            keepable=form is not None,
        )
        answer = words(told, exchange.head, page, self.shelf, form)
        close = told.word == "gone" or told.problem in _CLOSES
        exchange.client.answer(answer.head, answer.body, close=close)

    def _say_barred(self, exchange: Exchange, *, looked_up: bool) -> None:
        """Say that it was refused, and under which number."""
        refusal = exchange.refusal
        assert refusal is not None, "nothing else is refused at the door"
        if isinstance(refusal, SetAside):
            self.barrier.hit(refusal.letter)
        outcome = of_a_refused(exchange, looked_up=looked_up)
        answer = pages.barred(refusal, exchange.head, outcome)
        self._settle(exchange, outcome, answer.head.status)
        exchange.client.answer(answer.head, answer.body)

    # -- the end of a request --------------------------------------------------------------------------

    def _unlist(self, exchange: Exchange) -> None:
        self._held.leave(exchange)
        self._lost.pop(exchange, None)
        self._at_core.pop(exchange, None)
        self._keeping.pop(exchange, None)
        self.dock.leave(exchange)

    def _leave_room(self, exchange: Exchange) -> None:
        if exchange.in_room:
            exchange.in_room = False
            self.room.leave(exchange.browser)

    def _abandon(self, exchange: Exchange) -> None:
        """Let go of everything a request holds."""
        self._unlist(exchange)
        self._leave_room(exchange)
        self.release_bytes(exchange)
        exchange.client.limit.clear()
        exchange.body = []
        exchange.dial = None
        connection, exchange.upstream = exchange.upstream, None
        if connection is not None:
            connection.abandon()  # it still carries this request, so no other may follow on it

    def _settle(self, exchange: Exchange, word: str, status: int) -> None:
        self._abandon(exchange)
        if not exchange.met_outage:
            return
        exchange.met_outage = False
        head = exchange.head
        since_ns = exchange.lost_ns or exchange.waiting_ns
        waited_ms = (self._now_ns() - since_ns) // 1_000_000 if since_ns else 0
        path = head.path.decode("ascii", "replace")
        self.book.settle(Settled(head.method, path, head.key_hash, word, status, waited_ms))
        self._flush_book(over=False)

    def _flush_book(self, *, over: bool) -> None:
        if over:
            self.book.close()
        for line in self.book.take():
            self._teller.say_or_keep(line)

    def release_bytes(self, exchange: Exchange) -> None:
        """The bytes set aside for a request's body are free again."""
        self.room.give_bytes(exchange.kept_bytes)
        exchange.kept_bytes = 0


def _how(exchange: Exchange) -> str:
    return "replayed" if exchange.sends > 1 else "answered"
