"""The gateway's view of the core: it follows the feed, owns the connections, ends its own doubts, reports.

The feed's lines are folded into a `Standing`; what follows from it is done here: connections to an older
core are closed before a newer one is believed, a core that hung up is asked for its health until it
answers or the feed says more, and the sentinel is told when the gateway holds and when it serves. The
requests themselves are not known here; the desk is told that something changed.
"""

import asyncio
import logging
from collections.abc import Callable, Collection

import msgspec

from hardcore.crisis import standing as know
from hardcore.crisis.feed import Heard, ReleaseHeard, Teller, holding_line, served_line
from hardcore.crisis.heads import AnswerHead
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.standing import Standing
from hardcore.crisis.upstream import Pool, UpstreamConnection
from hardcore.crisis.witness import Witness
from hardcore.model.phases import Face

_LOG = logging.getLogger(__name__)
#: Connections to a core that was named, opened before it is released: as many as a browser waits with.
WARM_CONNECTIONS = 3
_HEALTH_REQUEST = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n"


class Errand:
    """A question of the gateway's own. `then` gets head and body, or None twice if no answer came."""

    __slots__ = ("_body", "_bytes_max", "_connection", "_head", "_then")

    def __init__(
        self,
        connection: UpstreamConnection,
        then: Callable[[AnswerHead | None, bytes], None],
        *,
        bytes_max: int,
    ) -> None:
        self._connection = connection
        self._then = then
        self._bytes_max = bytes_max
        self._head: AnswerHead | None = None
        self._body = bytearray()

    def headed(self, head: AnswerHead) -> None:
        """Keep the head."""
        self._head = head

    def came(self, data: bytes) -> None:
        """Keep a piece; a longer answer than was asked for is none."""
        self._body += data
        if len(self._body) > self._bytes_max:
            self._connection.abandon()
            self._then(None, b"")

    def ended(self) -> None:
        """Hand the answer over."""
        self._then(self._head, bytes(self._body))

    def lost(self) -> None:
        """No answer."""
        self._then(None, b"")

    def garbled(self) -> None:
        """No answer either."""
        self._then(None, b"")

    def dropped(self) -> None:
        """Whoever asked does not wait any more."""

    def flowing(self, *, on: bool) -> None:
        """A question has no body to slow down."""


class Ties(msgspec.Struct, frozen=True):
    """What the outlook calls: `changed` when requests may move, `teller` with a line for the sentinel."""

    changed: Callable[[], None]
    freed: Callable[[], None]
    teller: Teller
    now_ns: Callable[[], int]


class Outlook:
    """What is known about the core, and the connections to it."""

    def __init__(self, loop: asyncio.AbstractEventLoop, limits: GatewayLimits, ties: Ties) -> None:
        self.standing = Standing()
        self.posture = Face.HOLD
        self.pool: Pool | None = None
        self.watch: Callable[[Standing], None] = lambda _: None  # hears what was known, after each change
        self.ruled: Callable[[str], None] = lambda _: None  # hears which rule a core has refused by
        self._loop = loop
        self._limits = limits
        self._ties = ties
        self._holding_told = False
        self._served_due = False
        self._probing: object = None  # marks the probe that is out; a newer one makes its answer void
        self._probe_connection: UpstreamConnection | None = None
        self._retry: asyncio.TimerHandle | None = None
        self._retired: Pool | None = None  # the one before
        self._witness = Witness(loop, ties.teller, limits.witness_ms)

    @property
    def epoch(self) -> int:
        """The serving epoch, 0 if none was named."""
        return self.pool.epoch if self.pool is not None else 0

    # -- the feed --------------------------------------------------------------------------------------

    def hear(self, message: Heard) -> None:
        """Follow one message of the feed."""
        known = know.hear(self.standing, message, self._ties.now_ns())
        if known is None:
            return
        was = self.standing
        if known.generation != was.generation:
            self._witness.repeat()  # another sentinel listens: it has heard none of it
        if known.serving != was.serving:
            self._follow(known)
        if isinstance(message, ReleaseHeard):
            self._served_due = True
            self._become(known, was)
            self._ties.changed()  # also where the posture stayed: what was lost may be looked up now
            self._probe()
        else:
            self._become(known, was)

    def unsuspected(self, names: Collection[str]) -> None:
        """These are in the ledger: nothing can run them again."""
        self._become(know.unsuspected(self.standing, names))

    def _follow(self, known: Standing) -> None:
        """A newer core is named: believe nothing of the older one any more, then open up to the newer."""
        older, self.pool = self.pool, None
        self.standing = known
        self.posture = Face.HOLD
        self._part_with(older, drained=known.planned)
        if known.serving is not None:
            self.pool = Pool(
                self._loop,
                known.serving.socket,
                known.serving.epoch,
                connections_max=self._limits.upstream_connections_max,
                idle_ms=self._limits.upstream_idle_ms,
                freed=self._ties.freed,
            )
            self.pool.warm(WARM_CONNECTIONS)  # the first requests go out with the release

    def _part_with(self, older: Pool | None, *, drained: bool) -> None:
        """Hang up on a core at once, or soon if it was drained: its last answers may not be read yet."""
        if self._retired is not None:
            self._retired.close()
        self._retired = older
        if older is not None and drained:
            older.retire()
            self._loop.call_later(self._limits.retire_ms / 1000, older.close)
        elif older is not None:
            older.close()

    def _become(self, known: Standing, was: Standing | None = None) -> None:
        before, was = self.posture, was or self.standing
        self.standing = known
        self.posture = know.posture(known)
        if self.posture is Face.FORWARD:
            self._holding_told = False
        else:
            self._tell_holding()
        self.watch(was)  # people first: what follows may take a while
        if self.posture is not before:
            _LOG.info("posture %s -> %s (phase %s)", before, self.posture, known.phase or "not heard yet")
            self._ties.changed()

    def _tell_holding(self) -> None:
        if not self._holding_told:
            self._witness.tell()  # what comes next is chosen by what was passed on before
            self._holding_told = self._ties.teller.say(holding_line(self.standing.phase, self._ties.now_ns()))

    # -- doubt -----------------------------------------------------------------------------------------

    def doubt(self, pool: Pool) -> None:
        """The core behind `pool` hung up or refused: hold, and ask it until somebody knows more."""
        if pool is self.pool and not self.standing.doubted:
            self._become(know.doubt(self.standing))
            self._probe()

    def leaving(self, pool: Pool) -> None:
        """The core behind `pool` is leaving: nothing more goes to it unless it is released again."""
        if pool is self.pool:
            self._become(know.leaving(self.standing))

    def answered(self, pool: Pool) -> None:
        """An answer of this pool's epoch came through."""
        if self._served_due and pool is self.pool:
            self._served_due = not self._ties.teller.say(served_line(pool.epoch, self._ties.now_ns()))

    def passed_on(self, head: AnswerHead) -> None:
        """A client was given an answer that stands for a commit."""
        if head.commit is not None and head.epoch is not None:
            self._witness.saw(head.epoch, head.commit)

    # -- asking for its health -------------------------------------------------------------------------

    def _probe(self) -> None:
        """Ask the core for its health over a new connection: after a release, and while in doubt."""
        pool = self.pool
        if pool is None:
            return
        self._stop_probing()
        probe = self._probing = object()
        # Frozen, it accepts and never answers: then the next probe tries again over a new connection.
        self._retry = self._loop.call_later(
            self._limits.upstream_deadline_ms / 1000, self._probed, probe, None
        )
        pool.dial(lambda connection: self._dialled(probe, pool, connection))

    def _dialled(self, probe: object, pool: Pool, connection: UpstreamConnection | None) -> None:
        if connection is None:
            self._probed(probe, None)
            return
        if probe is not self._probing:
            pool.give_back(connection)
            return
        self._probe_connection = connection

        def judge(head: AnswerHead | None, _body: bytes) -> None:
            self._probe_connection = None
            fine = head is not None and head.status == 200 and head.epoch == pool.epoch
            self._probed(probe, pool if fine else None)

        errand = Errand(connection, judge, bytes_max=self._limits.answer_buffer_bytes_max)
        connection.ask(errand, _HEALTH_REQUEST, no_body=False, whole=True)

    def _probed(self, probe: object, pool: Pool | None) -> None:
        """A probe is back; `pool` is the core that answered it well, or None."""
        if probe is not self._probing:
            return
        self._stop_probing()
        if pool is not None:
            self.answered(pool)
            self._become(know.trust(self.standing))
        elif self.standing.doubted or self._served_due:
            if self.standing.doubted and not self.standing.unanswered:
                self._become(know.confirm(self.standing))
            self._retry = self._loop.call_later(self._limits.probe_ms / 1000, self._probe)

    def _stop_probing(self) -> None:
        self._probing = None
        unanswered, self._probe_connection = self._probe_connection, None
        if unanswered is not None:
            unanswered.abandon()
        if self._retry is not None:
            self._retry.cancel()
            self._retry = None

    # -- upkeep ----------------------------------------------------------------------------------------

    def upkeep(self) -> None:
        """Now and then: close connections that nobody used, and say again what could not be said."""
        if self.pool is not None:
            self.pool.prune()
        if self.posture is not Face.FORWARD:
            self._tell_holding()

    def close(self) -> None:
        """The gateway ends."""
        self._stop_probing()
        self._witness.close()
        pool, self.pool = self.pool, None
        self._part_with(pool, drained=False)
