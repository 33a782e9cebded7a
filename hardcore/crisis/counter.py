"""The counter: where the gateway answers in its own name, and nobody else is asked.

What monitors ask (`doors`), how things stand, its pages and files, and drills in a demo. Two things are not there in a
gateway's first moment: the shelf (it is rendered beside the serving) and a word of the core. Whoever asks for them
then waits for them, because a browser never asks again for a module that was not found, and a page believes what
it is told of the core. How many may wait is bounded by the connections.
"""

import asyncio
from collections.abc import Callable
from functools import partial
from typing import assert_never

from hardcore.crisis import pages
from hardcore.crisis.census import is_near
from hardcore.crisis.doors import DOOR_ROUTES, Doors
from hardcore.crisis.drills import Begun, Declined, DrillDoor, Said, Unheard, fault_of
from hardcore.crisis.exchange import Exchange
from hardcore.crisis.heads import RequestHead
from hardcore.crisis.holding import Life
from hardcore.crisis.live import Live
from hardcore.crisis.mishap import contained
from hardcore.crisis.moves import Moves
from hardcore.crisis.problems import Problem
from hardcore.crisis.routing import Route
from hardcore.crisis.shelf import Shelf


class Counter:
    """Answers requests for the gateway's own paths."""

    def __init__(
        self,
        moves: Moves,
        live: Live,
        doors: Doors,
        drills: DrillDoor | None,
    ) -> None:
        self._moves = moves
        self._live = live
        self._doors = doors
        self._drills = drills  # in a demo only
        self.wanted = asyncio.Event()  # somebody asks for what is on the shelf
        self._early: (
            list[Callable[[], None]] | None
        ) = []  # wait for what is not on the shelf; None: all of it is

    def stocked(self, shelf: Shelf) -> None:
        """All that can be shown was rendered: whoever asked for it too early is answered now."""
        self._moves.shelf = shelf
        early, self._early = self._early or [], None
        for then in early:
            contained("answering who asked early", then)

    def when_stocked(self, then: Callable[[], None]) -> None:
        """Do `then` once all that can be shown was rendered."""
        if self._early is None:
            then()
            return
        self._early.append(then)
        self.wanted.set()

    def asked(self, exchange: Exchange, way: Route) -> None:
        """Answer it, now or as soon as there is something to answer with."""
        exchange.life = Life.ANSWERED  # it never was on its way to a core
        self._moves.release_bytes(exchange)
        head, tongue = exchange.head, exchange.head.accept_language
        if way in DOOR_ROUTES:
            answer = self._doors.answer(head, way, exchange.client.address)
            exchange.client.answer(answer.head, answer.body)
            return
        fault = fault_of(head.path) if way is Route.DRILL else None
        if fault is not None and self._drills is not None and is_near(exchange.client.address):
            if head.method == "POST":
                self._drills.ask(fault, lambda said: self._drilled(exchange, said))
                return
            answer = pages.problem(Problem.METHOD_NOT_ALLOWED, tongue)
        elif way is Route.DRILL:
            answer = pages.problem(Problem.NOT_FOUND, tongue)
        elif head.method not in {"GET", "HEAD"}:
            answer = pages.problem(Problem.METHOD_NOT_ALLOWED, tongue)
        elif way is Route.STATUS:
            self._live.when_known(partial(self._give, exchange, way))
            return
        elif way is Route.OWN:  # a module that is not there is never asked for again
            self.when_stocked(partial(self._give, exchange, way))
            return
        else:
            self._give(exchange, way)
            return
        exchange.client.answer(answer.head, answer.body)

    def _give(self, exchange: Exchange, way: Route) -> None:
        answer = self._answer(exchange.head, way)
        exchange.client.answer(answer.head, answer.body)

    def _answer(self, head: RequestHead, way: Route) -> pages.Answer:
        if way is Route.STATUS:
            return self._live.status(head)
        sheet = self._moves.shelf.own(head.path, head.accept_language)
        if sheet is None:
            return pages.problem(Problem.NOT_FOUND, head.accept_language)
        return pages.own_page(sheet, head) if sheet.policy else pages.own_file(sheet, head)

    def _drilled(self, exchange: Exchange, said: Said) -> None:
        """The sentinel has answered who asked for a drill."""
        tongue = exchange.head.accept_language
        match said:
            case Begun(fault=fault):
                answer = pages.drill_begun(fault)
            case Declined(code=code):
                answer = pages.problem(Problem.DRILL_REFUSED, tongue, reason=code)
            case Unheard():
                answer = pages.problem(Problem.GUARD_AWAY, tongue)
            case _:
                assert_never(said)
        exchange.client.answer(answer.head, answer.body)
