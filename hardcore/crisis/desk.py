"""The front desk: where client connections bring requests, and where the feed's lines come in.

Clients never see a core and cores never see a client; the desk hands each fact to `moves` as a step of the
request it concerns. Everything runs in one thread, and nothing here waits.
"""

import asyncio
from collections import Counter as Tally
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import assert_never

from msgspec import structs

from hardcore.crisis.admin import AdminDoor
from hardcore.crisis.counter import Counter
from hardcore.crisis.doors import Doors, Traffic
from hardcore.crisis.drills import DrillDoor
from hardcore.crisis.exchange import Exchange
from hardcore.crisis.feed import (
    Heard,
    PhaseHeard,
    QuarantineHeard,
    ReleaseHeard,
    StandingHeard,
    SuspectsHeard,
    Teller,
    VerdictHeard,
)
from hardcore.crisis.gate import Gate
from hardcore.crisis.heads import RequestHead, browser_of
from hardcore.crisis.history import History
from hardcore.crisis.holding import OVER, WAITING, Life, Trigger, WaitingRoom
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.live import Live
from hardcore.crisis.mishap import contained
from hardcore.crisis.moves import TURNED_AWAY, Moves
from hardcore.crisis.problems import Problem
from hardcore.crisis.receipts import Receipt
from hardcore.crisis.receipts_form import form_in
from hardcore.crisis.routing import Route
from hardcore.crisis.sign_in import SignIn
from hardcore.crisis.sockets import Sockets
from hardcore.crisis.standing import Standing
from hardcore.model.phases import Face

#: Where requests for the ledger go.
_TO_CORE = frozenset({Route.FORWARD, Route.HOLD, Route.REFUSE})


class Desk:
    """The gateway's door."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        limits: GatewayLimits,
        teller: Teller,
        now_ns: Callable[[], int],
        drills: DrillDoor | None = None,
        history: History | None = None,
        receipts: Path | None = None,
        state: Path | None = None,
        investigator: Path | None = None,
        gate: Gate | None = None,
    ) -> None:
        self.limits = limits
        self.moves = Moves(loop, limits, teller, now_ns, receipts, state)
        self.admin = AdminDoor(loop, investigator, limits, teller)
        self.promises = self.moves.promises
        outlook, demo = self.moves.outlook, drills is not None
        self.history = history or History(loop, None)
        waiting, on_trial = self.moves.waiting, lambda: _by_browser(self.moves.dock.waiting())
        self.live = Live(loop, limits, self.history, waiting, on_trial, now_ns, self.promises, demo=demo)
        self.promises.told = self._told
        self.gate = gate or Gate(loop, limits, state, now_ns)
        self.sockets = Sockets(loop, outlook, self.live, limits, now_ns, self.gate)
        outlook.watch = self._look
        self.promises.shelf = lambda: self.moves.shelf
        self.connections: Callable[[], int] = lambda: 0  # how many clients are connected: the gateway says
        self.doors = Doors(lambda: outlook.standing, self._traffic, teller, limits.feed_silence_ms, now_ns)
        self.counter = Counter(self.moves, self.live, self.doors, drills)
        self.sign_in = SignIn(
            loop,
            self.gate,
            limits,
            lambda kind, tongue: self.moves.shelf.gate(kind, tongue),  # noqa: PLW0108  # the shelf is another one later
            self.counter.when_stocked,
        )

    @property
    def room(self) -> WaitingRoom:
        """Where bytes are asked for before they are read."""
        return self.moves.room

    def arrived(self, exchange: Exchange) -> None:
        """A request is here (whole, or to be streamed): decide its way."""
        exchange.browser = browser_of(exchange.head.cookie)
        way = self.moves.way(exchange.head.path)
        if (problem := self.gate.enters(exchange, way)) is not None:
            self._is_ours(exchange)
            self.sign_in.turned_away(exchange, problem)
            return
        self._let_in(exchange, way)

    def _let_in(self, exchange: Exchange, way: Route) -> None:
        if way in _TO_CORE:
            _read_key(exchange)
            if self._comes_early(exchange):
                return
            if (known := self.promises.knows(exchange)) is not None:
                self._is_ours(exchange)
                exchange.client.answer(known.head, known.body)
                return
            if self.moves.barrier.bars(exchange) and not exchange.askable:
                self.moves.move(exchange, Trigger.BARRED)
                return
        match way:
            case Route.LIVE | Route.READY | Route.STARTUP | Route.HEALTH | Route.METRICS:
                self.counter.asked(exchange, way)
            case Route.STATUS | Route.OWN | Route.DRILL:
                self.counter.asked(exchange, way)
            case Route.ADMIN:
                self._is_ours(exchange)
                self.admin.asked(exchange)
            case Route.GATE:
                self._is_ours(exchange)
                self.sign_in.asked(exchange)
            case Route.RECEIPT:
                self._is_ours(exchange)
                self.promises.asked(exchange)
            case Route.FORWARD if self._passes(exchange):
                self.moves.move(exchange, Trigger.PASS)
            case Route.FORWARD | Route.HOLD:
                self.moves.keep(exchange)
            case Route.REFUSE | Route.CLOSE:
                self.moves.turn_away(exchange, TURNED_AWAY[way])
            case _:
                assert_never(way)

    def _comes_early(self, exchange: Exchange) -> bool:
        """Whether it waits until the receipts are read: its key may have one, and may be one that was cancelled."""

        def again() -> None:
            if exchange.life is Life.ARRIVED:
                # It was let in before, and no longer says what opened the door.
                self._let_in(exchange, self.moves.way(exchange.head.path))

        keyed = exchange.head.key is not None and not exchange.head.safe
        return keyed and exchange.whole and not exchange.streamed and self.promises.reading.delays(again)

    def _is_ours(self, exchange: Exchange) -> None:
        """It never was on its way to a core."""
        exchange.life = Life.ANSWERED
        self.moves.release_bytes(exchange)

    def turns_away(self, head: RequestHead) -> Problem | None:
        """Whether a request would be turned away now: asked before its body is called for."""
        way = self.moves.way(head.path)
        return TURNED_AWAY[way] if way in {Route.REFUSE, Route.CLOSE} else None

    def body(self, exchange: Exchange, data: bytes) -> None:
        """A piece of a streamed body."""
        if exchange.upstream is not None:
            self.moves.courier.piece(exchange, data)
        elif exchange.life not in OVER:
            exchange.body.append(data)

    def body_whole(self, exchange: Exchange) -> None:
        """A streamed body is at its end."""
        if exchange.upstream is not None:
            self.moves.courier.last_piece(exchange)

    def faulty(self, exchange: Exchange, problem: Problem) -> None:
        """The rest of a request's body is too long, broken, or does not come."""
        if exchange.life not in OVER:
            exchange.fault = problem
            self.moves.move(exchange, Trigger.FAULT)

    def left(self, exchange: Exchange) -> None:
        """The client is gone."""
        self.admin.left(exchange)
        if exchange.life not in OVER:
            self.moves.move(exchange, Trigger.CLIENT_LEFT)

    def half_left(self, exchange: Exchange) -> None:
        """The client says no more, but may still read: whoever waits is told at once, in case he does."""
        self.admin.left(exchange, half=True)
        if exchange.life in WAITING:
            self.moves.move(exchange, Trigger.CLIENT_LEFT)

    def limit(self, exchange: Exchange) -> None:
        """The time of a request is over."""
        self.admin.limit(exchange)
        if exchange.life not in OVER:
            self.moves.time_is_over(exchange)

    def slow_reader(self, exchange: Exchange, *, slow: bool) -> None:
        """The client cannot take the answer as fast as it comes, or can again."""
        exchange.stalled = slow
        self.admin.slow_reader(exchange, slow=slow)
        if exchange.life is not Life.ANSWERING or exchange.upstream is None:
            return
        if slow:
            exchange.upstream.pause()
            exchange.client.limit.clear()  # the core is not to blame; the client has a limit of its own
        else:
            exchange.upstream.resume()
            exchange.client.limit.set(self.limits.upstream_deadline_ms)

    def forget(self, exchange: Exchange) -> None:
        """A request that never got its turn is dropped with its connection."""
        self.moves.release_bytes(exchange)

    def heard(self, message: Heard) -> None:
        """A line of the feed."""
        match message:
            case PhaseHeard(face=face, incident=str(incident)) if face is not Face.FORWARD:
                self.moves.book.begin()
                self.moves.book.name(incident)
            case ReleaseHeard(incident=incident):
                self.moves.book.name(incident)
            case _:
                pass
        current = message.generation >= self.moves.outlook.standing.generation
        self.moves.outlook.hear(message)
        if current:
            if isinstance(message, StandingHeard):
                self.doors.hear(message)
            contained("seeing to suspects", lambda: self._heard_of_suspects(message))

    def _passes(self, exchange: Exchange) -> bool:
        """Whether a request that has just come may go to the core at once."""
        moves = self.moves
        if not moves.core_has_room() or exchange.refusal is not None or moves.dock.suspects(exchange):
            return False
        return moves.precedence.lets(exchange)

    def _heard_of_suspects(self, message: Heard) -> None:
        """A line that is about suspects or rules, once the outlook has taken it in."""
        match message:
            case SuspectsHeard():
                self.moves.dock.suspected(message)
            case VerdictHeard():
                self.moves.dock.judged(message)
                self.moves.precedence.freed()
                self.promises.look(message.name)
            case QuarantineHeard():
                self.moves.barrier.look()
            case _:
                return
        self.moves.precedence.suspected()

    def _told(self, receipt: Receipt) -> None:
        """A promise was given, or something became of it: pages hear of it, and whoever waits behind it may go on."""
        self.live.promised(receipt)
        self.moves.precedence.freed()

    def upkeep(self) -> None:
        """What is due now and then."""
        self.gate.upkeep()
        self.moves.outlook.upkeep()
        self.moves.dock.departed.upkeep()
        self.moves.dock.cases.upkeep()
        self.admin.upkeep()
        self.live.upkeep()
        self.sockets.upkeep()
        self.promises.upkeep()

    def _traffic(self) -> Traffic:
        held, _ = self.moves.counts()
        return Traffic(held, len(self.sockets), self.connections(), self.moves.book.totals)

    def _look(self, was: Standing) -> None:
        """Something was learned about the core: whoever watches is told, and sockets go on."""
        self.doors.look()
        contained("telling pages", lambda: self.live.look(was, self.moves.outlook.standing))
        contained("moving sockets", self.sockets.look)
        contained("running receipts", self.promises.look)


def _by_browser(exchanges: Iterable[Exchange]) -> dict[bytes, int]:
    return Tally(one.browser for one in exchanges if one.browser is not None)


def _read_key(exchange: Exchange) -> None:
    """A page's form says its key in a field, because a browser alone can't say it in a header."""
    head = exchange.head
    if head.navigation and not head.safe and head.key is None and exchange.whole and not exchange.streamed:
        form = form_in(head, b"".join(exchange.body), "/")
        if form is not None:
            exchange.head = structs.replace(head, key=form.key.encode("ascii"))
