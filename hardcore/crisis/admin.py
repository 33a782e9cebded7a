"""The way to the investigators: passes `/admin` on to their process, in every phase, also while no core lives.

Only from this machine (a direct connection from loopback, under one of its own names, with no word of having been
forwarded), unless a password is set: then for its owner, from wherever he has signed in. Nothing of it is the ledger's: it
is never held for a core, never counted, never repeated. Who asks while nobody listens there is held while the guard
starts them, for as long as a person waits anyway. Letting the
guard's process pass the bytes was not chosen: the one that watches must not carry traffic.
"""

import asyncio
from collections.abc import Coroutine
from pathlib import Path
from typing import Final

import msgspec

from hardcore.crisis import pages
from hardcore.crisis.census import is_near
from hardcore.crisis.exchange import Exchange
from hardcore.crisis.feed import Teller, investigate_line
from hardcore.crisis.heads import AnswerHead, Header, RequestHead, host_name, request_bytes
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.mishap import contained
from hardcore.crisis.problems import Outcome, Problem
from hardcore.crisis.upstream import Pool, UpstreamConnection

#: Names of this machine for itself. What else the server answers to may be a proxy's name.
LOOPBACK_NAMES: Final = frozenset({"localhost", "127.0.0.1", "[::1]"})
#: Connections at a time; an open page that listens has one.
CONNECTIONS_MAX: Final = 32
#: An answer up to this size is kept whole; a longer one is passed on as it comes, up to ANSWER_BYTES_MAX.
KEPT_BYTES_MAX: Final = 256 << 10
ANSWER_BYTES_MAX: Final = 64 << 20
#: Between two tries to reach them, and between two words to the guard.
RETRY_MS: Final = 100
ASK_MS: Final = 1_000


class _Course(msgspec.Struct, eq=False):
    """One request on its way. `endless`: its answer has no end to wait for; `over`: nothing more is said to its client
    by us; `again`: it only reads, and is asked a second time, because whoever had it first is gone.
    """

    exchange: Exchange
    connection: UpstreamConnection | None = None
    begun: bool = False
    endless: bool = False
    over: bool = False
    again: bool = False
    passed_bytes: int = 0


class _Answer:
    """The asker of one request (see `upstream.Asker`): short answers whole, long ones as they come."""

    def __init__(self, door: "AdminDoor", course: _Course) -> None:
        self._door = door
        self._course = course
        self._head: AnswerHead | None = None
        self._parts: list[bytes] = []
        self._size = 0

    def headed(self, head: AnswerHead) -> None:
        """Wait for the rest, unless it has no end to wait for."""
        self._head = head
        if head.live:
            self._begin()

    def came(self, data: bytes) -> None:
        """Keep a piece, or pass it on."""
        if self._course.begun:
            self._door.more(self._course, data)
            return
        self._parts.append(data)
        self._size += len(data)
        if self._size > KEPT_BYTES_MAX:
            self._begin()

    def ended(self) -> None:
        """It is whole."""
        assert self._head is not None, "an answer ended that never began"
        if self._course.begun:
            self._door.finished(self._course)
        else:
            self._door.answered(self._course, pages.Answer(self._head, b"".join(self._parts)))

    def lost(self) -> None:
        """They are gone."""
        self._door.broken(self._course)

    def garbled(self) -> None:
        """What came is no answer."""
        self._door.broken(self._course)

    def dropped(self) -> None:
        """Nobody waits for it any more."""

    def flowing(self, *, on: bool) -> None:
        """A request is sent whole."""

    def _begin(self) -> None:
        assert self._head is not None, "an answer is passed on that never began"
        first, self._parts = b"".join(self._parts), []
        self._door.begun(self._course, pages.Answer(self._head, first), endless=self._head.live)


class AdminDoor:
    """Passes requests on. Without a path there is nobody to pass them to."""

    def __init__(
        self, loop: asyncio.AbstractEventLoop, path: Path | None, limits: GatewayLimits, teller: Teller
    ) -> None:
        self._loop = loop
        self._limits = limits
        self._teller = teller
        self._pool: Pool | None = None
        if path is not None:
            self._pool = Pool(
                loop,
                str(path),
                0,
                connections_max=CONNECTIONS_MAX,
                idle_ms=limits.upstream_idle_ms,
                freed=lambda: None,
            )
        self._courses: dict[Exchange, _Course] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._asked_s = float("-inf")

    def asked(self, exchange: Exchange) -> None:
        """Pass a request on, if it may be."""
        head = exchange.head
        if self._pool is None:
            self._refuse(exchange, Problem.NOT_FOUND)
        elif exchange.visitor.proven is None and not is_local(exchange.client.address, head):
            self._refuse(exchange, Problem.ADMIN_LOCAL)
        elif exchange.streamed or not exchange.whole:
            self._refuse(exchange, Problem.BODY_TOO_LARGE)
        elif len(self._courses) >= CONNECTIONS_MAX:
            self._refuse(exchange, Problem.TOO_BUSY)
        else:
            course = self._courses[exchange] = _Course(exchange)
            self._soon(self._pass_on(self._pool, course))

    async def _pass_on(self, pool: Pool, course: _Course) -> None:
        head, body = course.exchange.head, b"".join(course.exchange.body)
        connection = await self._connected(pool, course)
        if course.over:
            if connection is not None:
                pool.give_back(connection)
        elif connection is None:
            self._end(course)
            self._refuse(course.exchange, Problem.ADMIN_AWAY)
        else:
            course.connection = connection
            course.exchange.client.limit.set(self._limits.upstream_deadline_ms)
            data = request_bytes(head, length=len(body), own=_own(course.exchange)) + body
            connection.ask(_Answer(self, course), data, no_body=head.method == "HEAD", whole=True)

    async def _connected(self, pool: Pool, course: _Course) -> UpstreamConnection | None:
        """A connection; None: nobody listens there, not even after they were asked for."""
        # An idle one may have its end on its way, and what changes something is never sent twice.
        free = pool.idle() if course.exchange.head.safe and not course.again else None
        if free is not None:
            return free
        until_s = self._loop.time() + self._limits.investigator_ms / 1000
        while (connection := await self._dialled(pool)) is None and not course.over:
            if self._loop.time() >= until_s:
                return None
            self._call_for_them()
            await asyncio.sleep(RETRY_MS / 1000)
        return connection

    async def _dialled(self, pool: Pool) -> UpstreamConnection | None:
        answer: asyncio.Future[UpstreamConnection | None] = self._loop.create_future()

        def then(connection: UpstreamConnection | None) -> None:
            if not answer.done():
                answer.set_result(connection)
            elif connection is not None:
                pool.give_back(connection)

        pool.dial(then)
        connection = await answer
        return connection if connection is not None and connection.usable else None

    def _call_for_them(self) -> None:
        if self._loop.time() - self._asked_s >= ASK_MS / 1000 and self._teller.say(investigate_line()):
            self._asked_s = self._loop.time()

    # -- what comes back -------------------------------------------------------------------------------

    def answered(self, course: _Course, answer: pages.Answer) -> None:
        """A whole answer is here."""
        course.connection = None
        if self._end(course):
            course.exchange.client.answer(answer.head, answer.body)

    def begun(self, course: _Course, answer: pages.Answer, *, endless: bool) -> None:
        """An answer begins that is passed on as it comes. One without an end has no deadline."""
        if course.over:
            return
        course.begun, course.endless, course.passed_bytes = True, endless, len(answer.body)
        if endless:
            course.exchange.client.limit.clear()
        course.exchange.client.begin(answer.head, answer.body)

    def more(self, course: _Course, data: bytes) -> None:
        """A piece of the answer that was begun."""
        if course.over:
            return
        course.passed_bytes += len(data)
        if course.passed_bytes > ANSWER_BYTES_MAX:
            self._cut(course)
            return
        if not course.endless and not course.exchange.stalled:
            course.exchange.client.limit.set(self._limits.upstream_deadline_ms)
        course.exchange.client.more(data)

    def finished(self, course: _Course) -> None:
        """The answer that was begun is whole."""
        course.connection = None
        if self._end(course):
            course.exchange.client.end()

    def broken(self, course: _Course) -> None:
        """No answer comes, or no more of it."""
        course.connection = None
        if course.begun:
            self._cut(course)
        elif self._pool is not None and course.exchange.head.safe and not (course.again or course.over):
            course.again = True
            self._soon(self._pass_on(self._pool, course))
        elif self._end(course):
            safe = course.exchange.head.safe
            self._refuse(course.exchange, Problem.ADMIN_BROKEN, None if safe else Outcome.UNKNOWN)

    # -- the client ------------------------------------------------------------------------------------

    def left(self, exchange: Exchange, *, half: bool = False) -> None:
        """The client is gone; `half`: he says no more, and may still read what has an end."""
        course = self._courses.get(exchange)
        if course is not None and (course.endless or not half) and self._end(course) and half:
            exchange.client.end()

    def limit(self, exchange: Exchange) -> None:
        """Its time is over."""
        course = self._courses.get(exchange)
        if course is None:
            return
        connection, course.connection, course.again = course.connection, None, True
        if connection is not None:
            connection.abandon()
        self.broken(course)

    def slow_reader(self, exchange: Exchange, *, slow: bool) -> None:
        """The client can't take its answer as fast as it comes, or can again."""
        course = self._courses.get(exchange)
        if course is not None and course.connection is not None:
            if slow:
                course.connection.pause()
                exchange.client.limit.clear()  # the client has a limit of its own
            else:
                course.connection.resume()
                if not course.endless:
                    exchange.client.limit.set(self._limits.upstream_deadline_ms)

    def upkeep(self) -> None:
        """Now and then: close connections that nobody used."""
        if self._pool is not None:
            self._pool.prune()

    def leave(self) -> None:
        """The gateway leaves: what has no end by itself ends now."""
        for course in [one for one in self._courses.values() if one.endless]:
            if self._end(course):
                course.exchange.client.end()

    def close(self) -> None:
        """The gateway ends."""
        for task in self._tasks:
            task.cancel()
        if self._pool is not None:
            self._pool.close()

    # -- ends ------------------------------------------------------------------------------------------

    def _end(self, course: _Course) -> bool:
        """Let go of a course; False if that was done before."""
        if course.over:
            return False
        course.over = True
        self._courses.pop(course.exchange, None)
        course.exchange.client.limit.clear()
        connection, course.connection = course.connection, None
        if connection is not None:
            connection.abandon()
        return True

    def _cut(self, course: _Course) -> None:
        if self._end(course):
            course.exchange.client.cut()

    def _refuse(self, exchange: Exchange, problem: Problem, outcome: Outcome | None = None) -> None:
        head = exchange.head
        answer = (
            pages.plain(problem, head)
            if head.navigation
            else pages.problem(problem, head.accept_language, outcome)
        )
        exchange.client.answer(answer.head, answer.body)

    def _soon(self, deed: Coroutine[object, object, None]) -> None:
        task = self._loop.create_task(deed)
        self._tasks.add(task)
        task.add_done_callback(self._done)

    def _done(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled():
            contained("passing a page of the investigators on", task.result)


def _own(exchange: Exchange) -> tuple[Header, ...]:
    """What the gateway says of who asks: that he may, and where a password is set whether he typed it just now."""
    proven = exchange.visitor.proven
    if proven is None:
        return ((b"X-Admin", b"1"),)
    return (b"X-Admin", b"1"), (b"X-Proven", b"1" if proven else b"0")


def is_local(address: str, head: RequestHead) -> bool:
    """Whether whoever asks sits at this machine, as far as a connection can show it."""
    return is_near(address) and host_name(head.host) in LOOPBACK_NAMES and not head.forwarded
