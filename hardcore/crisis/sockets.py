"""All WebSockets: where each one leads, who waits for a core, and what becomes of them when the core changes.

The only room that knows both the sockets and the outlook. Cores are asked by a bounded number of sockets at a
time, so that five hundred tabs that wait do not fall upon a core in its first millisecond. A pool of
connections, as requests have it, was not chosen: a socket's connection is its own from its first byte to its last.
"""

import asyncio
from collections.abc import Callable
from functools import partial

from hardcore.access.sessions import Session
from hardcore.crisis import pages
from hardcore.crisis.browser_socket import BrowserSocket
from hardcore.crisis.burden import Burden
from hardcore.crisis.census import Census
from hardcore.crisis.core_socket import CoreSocket, NotTaken
from hardcore.crisis.gate import Entered, Gate
from hardcore.crisis.heads import RequestHead
from hardcore.crisis.lifeline import TRY_LATER, Line, Pull
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.live import LIVE_PATH, Live
from hardcore.crisis.mishap import contained
from hardcore.crisis.outlook import Outlook
from hardcore.crisis.problems import Outcome, Problem
from hardcore.crisis.routing import OWN_PREFIX, Route, is_admin
from hardcore.crisis.tunnel import Tunnel
from hardcore.model.phases import Face

#: Whoever was let in by a session that is over.
SIGNED_OUT = 4401
#: Why a socket that waits is turned away.
_TURNED_AWAY = {Face.REFUSE: Problem.NOT_SERVING, Face.CLOSED: Problem.SHUTTING_DOWN}


class Sockets:
    """Holds every socket."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        outlook: Outlook,
        live: Live,
        limits: GatewayLimits,
        now_ns: Callable[[], int],
        gate: Gate,
    ) -> None:
        self.leaving = False
        self._gate = gate
        self._guests: dict[BrowserSocket, Session] = {}  # who came in with a session that may end
        self._loop = loop
        self._outlook = outlook
        self._live = live
        self._limits = limits
        self._now_ns = now_ns
        self._all: set[BrowserSocket] = set()
        self._burden = Burden(limits.sockets_bytes_max)
        self._tunnels: dict[Tunnel, None] = {}
        self._waiting: dict[Tunnel, None] = {}  # in order of arrival
        self._asking: set[Tunnel] = set()
        self._dials: set[asyncio.Task[None]] = set()
        self._pump_due = False
        self._asks_at = loop.time() + limits.socket_ping_ms / 1000

    def __len__(self) -> int:
        """How many there are."""
        return len(self._all)

    def arrived(self, transport: asyncio.Transport, head: RequestHead, census: Census, address: str) -> None:
        """A client's connection is to become a socket; what it may be was judged with its head."""
        if not contained("a socket's beginning", lambda: self._begin(transport, head, census, address)):
            transport.abort()  # whoever brought it has let go of it: nobody else would

    def _begin(self, transport: asyncio.Transport, head: RequestHead, census: Census, address: str) -> None:
        entry = self._gate.entry(head, address, Route.STATUS if head.path == LIVE_PATH else Route.FORWARD)
        head = entry.head if isinstance(entry, Entered) else head
        socket = BrowserSocket(self._loop, transport, head, census, self._limits, self._burden)
        assert head.handshake is not None, "only a handshake is handed over"
        if self.leaving:
            socket.refuse(pages.problem(Problem.SHUTTING_DOWN, head.accept_language, Outcome.NOT_DONE))
            return
        if isinstance(entry, Problem):
            socket.refuse(self._gate.refusal(entry, head))
            return
        if len(self._all) >= self._limits.sockets_max:
            # Accepted first: a page is not told why a handshake failed, but it can read a code.
            socket.accept(next(iter(head.handshake.protocols), None), bytes_max=1)
            socket.close(TRY_LATER, "too many sockets")
            return
        self._all.add(socket)
        socket.gone.append(self._all.discard)
        if entry.visitor.session is not None:
            self._guests[socket] = entry.visitor.session
            socket.gone.append(self._forget_guest)
        if head.path == LIVE_PATH:
            self._live.join(socket)
            return
        if head.path.startswith(OWN_PREFIX) or is_admin(head.path):
            socket.refuse(pages.problem(Problem.NOT_FOUND, head.accept_language))
            return
        tunnel = Tunnel(self._loop, socket, self, self._limits, self._now_ns)
        self._tunnels[tunnel] = None
        tunnel.start()

    def _forget_guest(self, socket: BrowserSocket) -> None:
        self._guests.pop(socket, None)

    def look(self) -> None:
        """Something was learned about the core."""
        epoch = self._outlook.epoch
        for tunnel in list(self._tunnels):
            if tunnel.epoch not in {0, epoch}:
                self._contained(tunnel, tunnel.superseded)
        self._pump()

    def upkeep(self) -> None:
        """Now and then: see off those whose session is over, ask those who say nothing whether they are still there."""
        for socket, session in list(self._guests.items()):
            if not self._gate.is_open(session):
                socket.close(SIGNED_OUT, "signed out")
        if self._loop.time() >= self._asks_at:
            self._asks_at = self._loop.time() + self._limits.socket_ping_ms / 1000
            for socket in list(self._all):
                socket.ask()

    # -- tunnel.Board ----------------------------------------------------------------------------------

    def wait(self, tunnel: Tunnel) -> None:
        """It waits for a released core, unless none is coming."""
        self._waiting[tunnel] = None
        self._pump_soon()

    def rest(self, tunnel: Tunnel) -> None:
        """It waits no longer, neither for a core nor for one's answer."""
        self._waiting.pop(tunnel, None)
        if tunnel in self._asking:
            self._asking.discard(tunnel)
            self._pump_soon()

    def over(self, tunnel: Tunnel) -> None:
        """It is over."""
        self._tunnels.pop(tunnel, None)

    def listens(self, socket: BrowserSocket) -> None:
        """This browser is told of outages in-band."""
        self._live.add(socket)

    def doubt(self, epoch: int) -> None:
        """The core of `epoch` is not what it should be."""
        pool = self._outlook.pool
        if pool is not None and pool.epoch == epoch:
            self._outlook.doubt(pool)

    def leaves(self, epoch: int) -> None:
        """The core of `epoch` says that it is leaving."""
        pool = self._outlook.pool
        if pool is not None and pool.epoch == epoch:
            self._outlook.leaving(pool)

    def dial(self, tunnel: Tunnel, target: bytes) -> None:
        """Ask the serving core for a socket."""
        serving = self._outlook.standing.serving
        assert serving is not None, "nobody is asked while no core is named"
        core = tunnel.core = CoreSocket(
            tunnel.head, target, serving.epoch, self._limits, self._burden, tunnel
        )
        self._asking.add(tunnel)
        task = self._loop.create_task(self._dial(tunnel, core, serving.socket))
        self._dials.add(task)
        task.add_done_callback(self._dials.discard)

    async def _dial(self, tunnel: Tunnel, core: CoreSocket, path: str) -> None:
        try:
            await self._loop.create_unix_connection(lambda: core, path)
        except OSError:
            self._contained(tunnel, lambda: tunnel.learn(core, NotTaken()))

    # -- who may ask -----------------------------------------------------------------------------------

    def _pump_soon(self) -> None:
        if not self._pump_due and self._waiting:
            self._pump_due = True
            self._loop.call_soon(self._pump)

    def _pump(self) -> None:
        """Let those who wait ask the serving core, as many as may; turn them away if none is coming."""
        self._pump_due = False
        posture = self._outlook.posture
        if posture is Face.FORWARD:
            for tunnel in list(self._waiting):
                if len(self._asking) >= self._limits.socket_dials_max:
                    return
                if tunnel in self._waiting:
                    self._contained(tunnel, partial(tunnel.release, self._outlook.epoch))
        elif posture in _TURNED_AWAY:
            for tunnel in [one for one in self._waiting if one.line is Line.WAITING]:
                tunnel.turned_away = _TURNED_AWAY[posture]
                self._contained(tunnel, partial(tunnel.pull, Pull.TURN_AWAY))

    def _contained(self, tunnel: Tunnel, step: Callable[[], None]) -> None:
        """Take a step with one socket; a bug of ours with it ends this one and reaches no other."""
        if not contained("a socket", step):
            self.rest(tunnel)
            self.over(tunnel)
            tunnel.cut()
