"""One client's connection: keeps the order of its requests, bounds what it costs, gives back its answers.

Requests on a connection are answered in the order they came. While one is being answered, at most a slice
of what follows is parsed and the rest is not read at all, so a client that floods meets its own socket's
buffer. The connection is in one `Mode`, each with at most one deadline, and everything it may cost (head,
body, unread answer) has a bound. An error of ours ends this connection with a 500 and touches no other.
"""

import asyncio
import logging
from collections import deque
from collections.abc import Callable
from typing import cast

from hardcore.crisis.alarm import Alarm
from hardcore.crisis.census import NOWHERE, Census, address_of
from hardcore.crisis.desk import Desk
from hardcore.crisis.exchange import Exchange
from hardcore.crisis.heads import AnswerHead, RequestHead, answer_bytes
from hardcore.crisis.late import LateCaller
from hardcore.crisis.mishap import describe
from hardcore.crisis.pace import Pace, takes
from hardcore.crisis.parsing import RequestParser
from hardcore.crisis.problems import PLAIN, Outcome, Problem
from hardcore.crisis.recording import NOBODYS, Recording
from hardcore.crisis.turns import Mode, Refused, refusal_bytes, whole_bytes

_LOG = logging.getLogger(__name__)

#: Read at a time from one socket; one buffer for all, because each piece is copied out before the next.
READ_BYTES = 64 << 10
#: Parsed at a time outside a body of known length: bounds how many pipelined requests wait parsed.
SLICE_BYTES = 4 << 10
#: Unsent bytes of an answer above which its client counts as slow.
WRITE_HIGH_BYTES = 64 << 10

_SCRATCH = memoryview(bytearray(READ_BYTES))


class ClientConnection(asyncio.BufferedProtocol):
    """One connection. It is the desk's `exchange.Client`, the parser's `Listener` and asyncio's protocol."""

    def __init__(
        self, loop: asyncio.AbstractEventLoop, desk: Desk, census: Census, recording: Recording = NOBODYS
    ) -> None:
        self.loop, self.limit = loop, Alarm(loop, self._limit_rings)
        self.address = NOWHERE
        self._desk = desk
        self._limits = desk.limits
        self._census = census
        self._transport: asyncio.Transport | None = None
        self._parser = RequestParser(self, census.hosts, desk.limits.header_bytes_max, recording)
        self._watch = Alarm(loop, self._watch_rings)
        self._mode = Mode.IDLE
        self._queue: deque[Exchange | Refused] = deque()
        self._parsing: Exchange | None = None  # whose body is being parsed
        self._rest = b""  # read and not yet parsed
        self._eof = False
        self._advancing = False
        self._reading = True
        self._begun: AnswerHead | None = None  # of the answer that is being streamed
        self._chunked = False
        self._pace = Pace(desk.limits.header_timeout_ms, desk.limits.body_bytes_per_s_min)
        self._unread = census.unread.share()
        self._unsent_bytes = 0
        self._left_ns = 0

    # -- asyncio ---------------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Join the others, unless there are too many."""
        self._transport = cast("asyncio.Transport", transport)
        self.address = address = address_of(transport)
        self._transport.set_write_buffer_limits(high=WRITE_HIGH_BYTES)
        self._watch.set(self._limits.keepalive_ms)
        full, crowded = self._census.is_full(address, self._limits), self._census.is_crowded(self._limits)
        self._census.enter(self, NOWHERE if full else address)
        if full and self._limits.door_callers_max:
            self._mode = Mode.LEAVING
            LateCaller(self, self._desk.doors, self._census, self._limits).take(transport)
        elif full:
            self.turn_away(linger=not crowded)

    def turn_away(self, *, linger: bool) -> None:
        """There is no place for this one."""
        self._parser.deaf = True
        self._write(refusal_bytes(Refused(Problem.TOO_BUSY), Outcome.NOT_DONE))
        self._leave(linger=linger)

    def connection_lost(self, exc: Exception | None) -> None:
        """Let go of everything."""
        del exc  # why a client left makes no difference
        self._transport = None
        self._unread.weighs(0)
        self._census.leave(self)
        self._drop_queue()
        self._watch.close()
        self.limit.close()

    def get_buffer(self, sizehint: int) -> memoryview:
        """The one buffer for all."""
        del sizehint  # it is as large as it is
        return _SCRATCH

    def buffer_updated(self, nbytes: int) -> None:
        """Parse what came, or keep it until its turn."""
        if self._mode is Mode.LEAVING:
            self._hear_out()
            return
        data = bytes(_SCRATCH[:nbytes])
        self._rest = self._rest + data if self._rest else data
        self._guarded(self._advance)

    def eof_received(self) -> bool:
        """The client says no more. What it asked for is still answered: it may be reading (TLS knows no half ends)."""
        self._eof = True
        self._guarded(self._client_ends)
        return self._transport is None or self._transport.get_extra_info("sslcontext") is None

    def pause_writing(self) -> None:
        """The client takes its answer slowly: what waits for it counts."""
        if self._transport is None:
            return
        self._unsent_bytes = self._transport.get_write_buffer_size()
        if not self._unread.weighs(self._unsent_bytes):
            self.cut()
            return
        if self._mode is Mode.LEAVING:
            return
        self._mode = Mode.STALLED
        self._watch.set(self._limits.client_stall_ms)
        if (current := self._current()) is not None:
            self._desk.slow_reader(current, slow=True)

    def resume_writing(self) -> None:
        """The client has caught up."""
        self._unread.weighs(0)
        if self._mode is not Mode.STALLED:
            return
        self._mode = Mode.DESK
        self._watch.clear()
        if (current := self._current()) is not None:
            self._desk.slow_reader(current, slow=False)
        self._guarded(self._advance)

    # -- parsing.Listener ------------------------------------------------------------------------------

    def headed(self, head: RequestHead) -> None:
        """A request begins: set aside what its body will take, before it is read."""
        length = head.content_length
        if length is not None and length > self._limits.body_bytes_max:
            self._parser.refuse(Problem.BODY_TOO_LARGE, head.accept_language)
            return
        exchange = Exchange(self, head, self._census.now_ns(), self._parser.place)
        exchange.streamed = self._desk.gate.streams(head, self.address)
        if length and not exchange.streamed:
            if not self._desk.room.take_bytes(length):
                self._parser.refuse(Problem.TOO_BUSY, head.accept_language)
                return
            exchange.kept_bytes = length
        self._queue.append(exchange)
        self._parsing = exchange
        self._pace.begin(exchange.arrived_ns)

    def refused(self, problem: Problem, accept_language: str, *, no_body: bool) -> None:
        """Nothing more can be read here: say so in its turn."""
        exchange, self._parsing = self._parsing, None
        if exchange is None:
            self._queue.append(Refused(problem, accept_language, no_body))
        elif exchange.started:
            self._desk.faulty(exchange, problem)
        else:
            exchange.fault = problem

    def came(self, data: bytes) -> None:
        """A piece of a body: keep it, or pass it on."""
        exchange = self._parsing
        if exchange is None:
            return
        exchange.received_bytes += len(data)
        self._pace.moved(len(data))
        if exchange.received_bytes > self._limits.body_bytes_max:
            self._parser.refuse(Problem.BODY_TOO_LARGE)
        elif exchange.streamed and exchange.started:
            self._desk.body(exchange, data)
        else:
            self._keep(exchange, data)

    def whole(self) -> None:
        """A body is at its end."""
        exchange, self._parsing = self._parsing, None
        if exchange is not None:
            exchange.whole = True
            if exchange.started:
                self._desk.body_whole(exchange)

    def _keep(self, exchange: Exchange, data: bytes) -> None:
        if exchange.head.content_length is None:  # a body of unknown length is counted as it comes
            if not self._desk.room.take_bytes(len(data)):
                self._parser.refuse(Problem.TOO_BUSY)
                return
            exchange.kept_bytes += len(data)
            exchange.streamed = exchange.received_bytes > self._limits.replay_body_bytes_max
        exchange.keep(data)

    # -- the order of things ---------------------------------------------------------------------------

    def _guarded(self, step: Callable[[], None]) -> None:
        """Run a step; a bug of ours in it ends this connection and no other."""
        try:
            step()
        except Exception as error:  # noqa: BLE001 - whatever it was, it belongs to this connection alone
            _LOG.error("a client connection failed: %s", describe(error))
            if self._begun is not None or self._mode is Mode.LEAVING:
                self.cut()
                return
            self._write(refusal_bytes(Refused(Problem.GATEWAY_FAULT), Outcome.UNKNOWN))
            self._leave(linger=True)

    def _current(self) -> Exchange | None:
        """The request whose turn it is, once the desk has it."""
        item = self._queue[0] if self._queue else None
        return item if isinstance(item, Exchange) and item.started else None

    def _advance(self) -> None:
        """Start what can be started and parse what may be parsed, until neither is possible."""
        if self._advancing:
            return
        self._advancing = True
        try:
            while self._mode is not Mode.LEAVING and self._transport is not None:
                if self._start_next():
                    continue
                if not self._rest or self._busy():
                    break
                self._parse_slice()
        finally:
            self._advancing = False
        self._choose_mode()

    def _busy(self) -> bool:
        """Whether parsing on would only pile up work behind the request whose turn it is."""
        if self._mode is Mode.STALLED or self._parser.deaf:
            return True
        item = self._queue[0] if self._queue else None
        return isinstance(item, Exchange) and (item.whole or (item.streamed and not item.flowing))

    def _parse_slice(self) -> None:
        body = self._parsing
        size = SLICE_BYTES
        if body is not None and body.head.content_length is not None:
            size = max(size, body.head.content_length - body.received_bytes)
        data, self._rest = self._rest[:size], self._rest[size:]
        self._parser.feed(data)

    def _start_next(self) -> bool:
        """Hand the next request to the desk, if it is ready for it; True if anything happened."""
        if not self._queue or self._mode is Mode.STALLED:
            return False
        item = self._queue[0]
        if isinstance(item, Refused):
            self._queue.popleft()
            self._write(refusal_bytes(item, None if item.problem in PLAIN else Outcome.NOT_DONE))
            self._leave(linger=True)
            return True
        if item.started:
            return False
        if item.fault is None and item.head.expects_continue:
            item.fault = self._desk.turns_away(item.head)
        if item.fault is None and not item.whole and not item.streamed:
            self._call_for_body(item)
            return False
        item.started = True
        self._mode = Mode.DESK
        if item.fault is not None:
            self._desk.faulty(item, item.fault)
        elif item.head.handshake is not None:
            self._hand_over(item)
        else:
            self._desk.arrived(item)
            item.place.passed_on()
            if self._eof:
                self._desk.half_left(item)
        return True

    def _hand_over(self, item: Exchange) -> None:
        """A WebSocket is another protocol: whoever speaks it gets the transport, and this ends."""
        if self._rest or self._parser.overrun or self._eof:  # it has to wait for our answer
            item.fault = Problem.BAD_REQUEST
            self._desk.faulty(item, item.fault)
            return
        transport, self._transport = self._transport, None
        assert transport is not None, "nothing is started on a connection that is gone"
        self._over()
        self._desk.sockets.arrived(transport, item.head, self._census, self.address)
        self.connection_lost(None)

    def _call_for_body(self, item: Exchange) -> None:
        """Answer `Expect: 100-continue`, once, unless the body has begun to come by itself."""
        if item.head.expects_continue and not item.called:
            item.called = True
            if not item.received_bytes:
                self._write(b"HTTP/1.1 100 Continue\r\n\r\n")

    def _client_ends(self) -> None:
        """The client has said all it wants to say."""
        if self._mode is Mode.LEAVING:
            self._close()
            return
        current = self._current()
        if current is None:
            self._advance()
        elif current.whole:
            self._desk.half_left(current)
        else:
            self._desk.left(current)

    def _choose_mode(self) -> None:
        """Settle what to wait for now, and whether to read meanwhile."""
        if self._mode is Mode.LEAVING or self._transport is None:
            return
        waits = self._current() is not None or self._mode is Mode.STALLED
        if not waits and (self._eof or self._parser.deaf):
            self._leave(linger=not self._eof)
            return
        self._read_on(on=not self._rest)
        if self._mode is Mode.STALLED:
            return
        before, self._mode = self._mode, self._waits_for()
        if self._mode is Mode.BODY:
            if before is not Mode.BODY:
                self._pace.go_on(self._census.now_ns())
            self._watch.set(self._pace.left_ms(self._census.now_ns()))
        elif self._mode is Mode.HEAD and before is not Mode.HEAD:
            self._watch.set(self._limits.header_timeout_ms)
        elif self._mode is Mode.IDLE and before is not Mode.IDLE:
            self._watch.set(self._limits.keepalive_ms)
        elif self._mode is Mode.DESK:
            self._watch.clear()

    def _waits_for(self) -> Mode:
        if self._queue:
            item = self._queue[0]
            flows = isinstance(item, Exchange) and not item.whole and (item.flowing or not item.streamed)
            return Mode.BODY if flows else Mode.DESK
        return Mode.HEAD if self._parser.in_head else Mode.IDLE

    def _read_on(self, *, on: bool) -> None:
        if self._transport is None or on is self._reading or self._transport.is_closing():
            return
        self._reading = on
        if on:
            self._transport.resume_reading()
        else:
            self._transport.pause_reading()

    # -- deadlines -------------------------------------------------------------------------------------

    def _limit_rings(self) -> None:
        if (current := self._current()) is not None:
            self._guarded(lambda: self._desk.limit(current))

    def _watch_rings(self) -> None:
        match self._mode:
            case Mode.IDLE:
                self._leave(linger=False)
            case Mode.HEAD | Mode.BODY:
                self._parser.refuse(Problem.REQUEST_TIMEOUT)
                self._guarded(self._advance)
            case Mode.STALLED | Mode.LEAVING:
                self._look_at_progress()
            case Mode.DESK:
                pass

    def _look_at_progress(self) -> None:
        """A client that takes enough is slow; one that takes next to nothing keeps the place of others."""
        if self._transport is None:
            return
        unsent, limits = self._transport.get_write_buffer_size(), self._limits
        if takes(self._unsent_bytes, unsent, limits.client_stall_ms, limits.body_bytes_per_s_min):
            self._unsent_bytes = unsent
            self._watch.set(self._limits.client_stall_ms)
        else:
            self.cut()

    # -- exchange.Client: answers ----------------------------------------------------------------------

    def answer(self, head: AnswerHead, body: bytes, *, close: bool = False) -> None:
        """Give a whole answer to the request whose turn it is."""
        if self._transport is None or self._mode is Mode.LEAVING:
            return
        exchange = self._over()
        ends = close or self._ends_after(exchange)
        self._write(whole_bytes(exchange.head, head, body, close=ends))
        self._after_answer(exchange, ends=ends)

    def begin(self, head: AnswerHead, first: bytes) -> None:
        """Begin an answer whose rest is still coming. HTTP/1.0 knows no chunks: its end is ours."""
        exchange = self._current()
        if exchange is None:
            return
        http10 = exchange.head.http10
        self._begun, self._chunked = head, head.length is None and not http10
        ends = self._ends_after(exchange) or (http10 and head.length is None)
        said = answer_bytes(head, length=head.length, chunked=self._chunked, close=ends, http10=http10)
        exchange.closes = ends
        self._write(said)
        self.more(first)

    def more(self, data: bytes) -> None:
        """Give a piece of the answer that was begun."""
        if data:
            self._write(b"%x\r\n%b\r\n" % (len(data), data) if self._chunked else data)

    def end(self) -> None:
        """The answer that was begun is whole."""
        if self._begun is None or not self._queue:
            return
        exchange = self._over()
        if self._chunked:
            self._write(b"0\r\n\r\n")
        self._begun = None
        self._after_answer(exchange, ends=exchange.closes)

    def cut(self) -> None:
        """End the connection at once."""
        if self._transport is not None:
            self._transport.abort()

    def flow(self) -> None:
        """Read on, if the request's body has somewhere to go now."""
        if (current := self._current()) is not None and current.flowing:
            self._call_for_body(current)
        self._guarded(self._advance)

    def depart(self) -> None:
        """The gateway leaves: an idle connection ends now, any other with its answer.

        Half a request is answered as well: whoever is still saying it would otherwise be left without a word.
        """
        if self._mode is Mode.IDLE and not self._queue:
            self._leave(linger=False)
        elif self._mode in {Mode.HEAD, Mode.BODY} and self._current() is None:
            self._parser.refuse(Problem.SHUTTING_DOWN)
            self._guarded(self._advance)

    def _over(self) -> Exchange:
        """Take the request whose turn it is out of the line."""
        exchange = self._queue.popleft()
        assert isinstance(exchange, Exchange)
        exchange.place.leave()
        return exchange

    def _ends_after(self, exchange: Exchange) -> bool:
        return not (exchange.head.keep_alive and exchange.whole) or self._desk.moves.leaving

    def _after_answer(self, exchange: Exchange, *, ends: bool) -> None:
        if ends:
            self._leave(linger=not exchange.whole or bool(self._rest))
        else:
            self._guarded(self._advance)

    def _write(self, data: bytes) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(data)

    def _leave(self, *, linger: bool) -> None:
        """End after what was written. Who still sends is heard out: a reset would overtake the answer."""
        self._mode, self._rest, self._left_ns = Mode.LEAVING, b"", self._census.now_ns()
        self._drop_queue()
        if self._transport is None:
            return
        self._unsent_bytes = self._transport.get_write_buffer_size()
        if linger and not self._eof and self._transport.can_write_eof():
            self._read_on(on=True)
            self._transport.write_eof()
            self._hear_out()
        else:
            self._close()

    def _hear_out(self) -> None:
        """Wait on for a client that still sends: many browsers read an answer only when all is sent."""
        gone_ms = (self._census.now_ns() - self._left_ns) / 1_000_000
        self._watch.set(max(0.0, min(self._limits.linger_ms, self._limits.linger_total_ms - gone_ms)))

    def _close(self) -> None:
        if self._transport is not None:
            self._transport.close()
            self._watch.set(self._limits.client_stall_ms)

    def _drop_queue(self) -> None:
        """Whoever still waits here lost his connection."""
        queue, self._queue, self._parsing = self._queue, deque(), None
        self._parser.place.leave()
        for item in queue:
            if isinstance(item, Exchange):
                item.place.leave()
                if item.started:
                    self._desk.left(item)
                self._desk.forget(item)
