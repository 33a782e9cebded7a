"""One browser's socket that leads to the core: the two ends, and the steps along the table in `lifeline`.

Both ends and the outlook only cause steps; the table gives the deed, and the deed is done here. What a core
says is passed on only while it is the one this socket is led to, so that nothing an older core still has to say
can follow a newer one's words.
"""

import asyncio
from collections.abc import Callable
from typing import Protocol, assert_never

from hardcore.crisis import pages
from hardcore.crisis.alarm import Alarm
from hardcore.crisis.browser_socket import BrowserSocket
from hardcore.crisis.core_socket import (
    Accepted,
    Broken,
    Closed,
    CoreSocket,
    Declined,
    Fact,
    Lost,
    NotTaken,
    Told,
)
from hardcore.crisis.heads import AnswerHead, RequestHead
from hardcore.crisis.lifeline import (
    GOING_AWAY,
    NORMAL,
    RESTARTED,
    RESUMABLE,
    TABLE,
    TRY_LATER,
    Line,
    Pull,
    Tug,
    sayable,
    seq_after,
    seq_asked,
    target_after,
    when_closed,
    when_released,
)
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.messages import Message, frame_of
from hardcore.crisis.pages import Answer
from hardcore.crisis.problems import Outcome, Problem

NS_PER_MS = 1_000_000


class Board(Protocol):
    """Who knows the cores, and everybody who waits for one."""

    def wait(self, tunnel: "Tunnel") -> None:
        """It waits for a released core."""

    def rest(self, tunnel: "Tunnel") -> None:
        """It waits no longer."""

    def dial(self, tunnel: "Tunnel", target: bytes) -> None:
        """Give the socket a core's end that asks the serving core with `target`, or tells it that there is none."""

    def doubt(self, epoch: int) -> None:
        """The core of `epoch` hung up, refused a connection, or is another one."""

    def leaves(self, epoch: int) -> None:
        """The core of `epoch` says that it is leaving."""

    def listens(self, socket: BrowserSocket) -> None:
        """This browser is told of outages in-band."""

    def over(self, tunnel: "Tunnel") -> None:
        """It is over."""


class Tunnel:
    """One socket. It is the browser's `Party` and the core's `CoreParty`."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        socket: BrowserSocket,
        board: Board,
        limits: GatewayLimits,
        now_ns: Callable[[], int],
    ) -> None:
        self.line = Line.WAITING
        self.core: CoreSocket | None = None
        self.turned_away = Problem.RECOVERING
        self._socket = socket
        self._board = board
        self._limits = limits
        self._limit = Alarm(loop, self._ring)
        self._now_ns = now_ns
        self._arrived_ns = now_ns()
        self._refusal: Answer | None = None
        self._core_code = 0  # with which the core closed its end
        self._browser_code: int | None = None  # and the browser
        self._subprotocol: str | None = None
        self._seen = seq_asked(socket.head.target)
        self._losses = 0
        self._lost_epoch = 0
        socket.party = self

    @property
    def epoch(self) -> int:
        """Of the core it is led to, or asks; 0: of none."""
        return self.core.epoch if self.core is not None else 0

    @property
    def head(self) -> RequestHead:
        """What the browser asked for."""
        return self._socket.head

    def start(self) -> None:
        """Begin to wait."""
        self._wait(answered=False)

    def release(self, epoch: int) -> None:
        """A released core of `epoch` takes sockets."""
        losses = self._losses if epoch == self._lost_epoch else 0
        resumable = self._subprotocol == RESUMABLE
        self.pull(when_released(self.line, resumable=resumable, losses=losses))

    def _ring(self) -> None:
        """Its time is over."""
        if self.line is not Line.OPEN:
            self.pull(Pull.LIMIT)

    # -- one step along the table ----------------------------------------------------------------------

    def pull(self, pull: Pull) -> None:
        """Take one step of the table."""
        before = self.line
        self.line, deed = TABLE[before, pull]
        assert deed is not Tug.NEVER, f"{pull} cannot happen to a socket in {before}"
        if deed is Tug.NOTHING:
            return
        self._board.rest(self)
        match deed:
            case Tug.ASK:
                self._limit.set(self._limits.upstream_deadline_ms)
                target, goes_on = self.head.target, self.line is Line.RESUMING
                self._board.dial(self, target_after(target, self._seen) if goes_on else target)
            case Tug.WAIT | Tug.KEEP:
                self._wait(answered=deed is Tug.KEEP)
            case Tug.OPEN | Tug.JOIN:
                self._open(answer=deed is Tug.OPEN)
            case _:
                self._end(deed)
        if self.line is Line.OVER:
            self._let_go()

    def _wait(self, *, answered: bool) -> None:
        self._drop_core()
        if answered:
            self._limit.clear()  # the browser's end may stay as long as the browser does
        else:
            gone_ms = (self._now_ns() - self._arrived_ns) / NS_PER_MS
            self._limit.set(max(0.0, self._limits.hold_ms - gone_ms))
        self._board.wait(self)

    def _open(self, *, answer: bool) -> None:
        self._limit.clear()
        assert self.core is not None, "only a core that is here can accept"
        if answer:
            self._subprotocol = self.core.subprotocol
            self._socket.accept(self._subprotocol, bytes_max=self._limits.socket_message_bytes_max)
            if self._subprotocol == RESUMABLE:
                self._board.listens(self._socket)

    def _end(self, deed: Tug) -> None:
        match deed:
            case Tug.PASS_REFUSAL:
                assert self._refusal is not None, "a refusal is an answer"
                self._socket.refuse(self._refusal)
            case Tug.SAY_BROKEN:
                self._say(Problem.BROKEN_ANSWER)
            case Tug.SAY_NOT_DONE:
                self._say(self.turned_away)
            case Tug.SAY_LATE:
                self._say(Problem.CORE_TOO_SLOW)
            case Tug.PASS_CLOSE:
                self._socket.close(sayable(self._core_code, NORMAL))
            case Tug.END_RESTARTED:
                self._socket.close(RESTARTED, "service restart")
            case Tug.END_LATER:
                self._socket.close(TRY_LATER, "try again later")
            case _:
                assert deed is Tug.LET_GO, f"{deed} ends nothing"

    def _say(self, problem: Problem) -> None:
        self._socket.refuse(pages.problem(problem, self.head.accept_language, Outcome.NOT_DONE))

    def _drop_core(self) -> None:
        core, self.core = self.core, None
        if core is not None:
            core.leave(sayable(self._browser_code, GOING_AWAY))
            self._socket.slow_down(on=False)  # whatever its pace was, it was this core's

    def _let_go(self) -> None:
        self._drop_core()
        self._limit.close()
        self._board.over(self)

    # -- the browser's end -----------------------------------------------------------------------------

    def said(self, message: Message) -> None:
        """Pass it on. While no core is there it is let go: a conversation that was lost is begun anew."""
        if self.line is Line.OPEN and self.core is not None:
            self.core.say(message)

    def left(self, code: int | None) -> None:
        """The browser's end is gone."""
        self._browser_code = code
        self.pull(Pull.LEFT)

    def leaves(self) -> None:
        """The gateway leaves."""
        self.turned_away = Problem.SHUTTING_DOWN
        self.pull(Pull.LEAVE)

    # -- the core's end --------------------------------------------------------------------------------

    def learn(self, core: CoreSocket, fact: Fact) -> None:
        """Something happened at the core's end; of one that was left, nothing counts any more."""
        if core is not self.core:
            return
        match fact:
            case Told(message=message):
                self._pass_on(message)
            case Accepted(head=head):
                self._judge(core, head)
            case Declined(answer=answer):
                self._decline(core, answer)
            case Broken():
                self._mistaken(core)
            case NotTaken():
                self.pull(Pull.NOT_TAKEN)
                self._board.doubt(core.epoch)
            case Closed(code=code):
                self._core_code = code
                self._lose(core, when_closed(code))
            case Lost():
                self._lose(core, Pull.CORE_LOST)
            case _:
                assert_never(fact)

    def _pass_on(self, message: Message) -> None:
        """Pass on what the core says, and remember how far the browser has seen."""
        if self.line is not Line.OPEN:
            return
        if self._subprotocol == RESUMABLE and message.text:
            self._seen = seq_after(self._seen, message.data)
        self._socket.send(frame_of(message))

    def _judge(self, core: CoreSocket, head: AnswerHead) -> None:
        other = self.line is Line.RESUMING and core.subprotocol != self._subprotocol
        if head.epoch != core.epoch or other:
            self._mistaken(core)
        else:
            self.pull(Pull.ACCEPTED)

    def _decline(self, core: CoreSocket, answer: Answer) -> None:
        if answer.head.epoch not in {None, core.epoch}:
            self._mistaken(core)
        elif answer.head.draining and answer.head.status == 503:
            self._board.leaves(core.epoch)
            self.pull(Pull.NOT_TAKEN)
        else:
            self._refusal = answer
            self.pull(Pull.REFUSED)

    def _mistaken(self, core: CoreSocket) -> None:
        """Step away first, so that nothing the doubt sets going finds this one led to a stranger."""
        self.pull(Pull.BROKEN)
        self._board.doubt(core.epoch)

    def _lose(self, core: CoreSocket, pull: Pull) -> None:
        if pull is Pull.CORE_LOST:
            self._losses = self._losses + 1 if self._lost_epoch == core.epoch else 1
            self._lost_epoch = core.epoch
        self.pull(pull)
        if pull is Pull.CORE_LOST:
            self._board.doubt(core.epoch)

    def superseded(self) -> None:
        """Another core was named: nothing more is taken from this one."""
        self.pull(Pull.CORE_LOST)

    def cut(self) -> None:
        """End both ends at once."""
        self.line = Line.OVER
        self._let_go()
        self._socket.cut()

    def flowing(self, core: CoreSocket, *, on: bool) -> None:
        """Let the browser wait with what it says, or go on."""
        if core is self.core:
            self._socket.slow_down(on=not on)
