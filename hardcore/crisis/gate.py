"""The gate: whoever comes in by the gateway has been seen here first, in every phase of a crisis.

Sessions are the gateway's own, so nobody is signed out by a core that dies; they are kept on disk, so the next gateway
knows them too. What opened the door goes no further: the core hears a name (`X-Actor`), on its own socket. While no password
is set nothing of this is asked, and only this machine is served. Who may come in is written by the owner's command line
and read again when the file changes; a file that can't be read lets nobody in.
"""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec

from hardcore.access import files
from hardcore.access.doorway import Client, Doorway, Proxies
from hardcore.access.people import People
from hardcore.access.sessions import Session, Sessions, Spans
from hardcore.crisis import pages
from hardcore.crisis.census import AT_HOME, is_near
from hardcore.crisis.exchange import Exchange
from hardcore.crisis.heads import RequestHead
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.mishap import contained
from hardcore.crisis.problems import Problem
from hardcore.crisis.routing import GATE_PATHS, Route
from hardcore.crisis.visitors import PUBLIC, THE_OWNER, Visitor, judged, visitor_of, without_credentials
from hardcore.host import clock

#: A name, a password and a path are no more than this.
FORM_BYTES_MAX: Final = 16 << 10
_MS: Final = 1_000_000
_LOOK_AGAIN_NS: Final = 20 * _MS


class Entered(msgspec.Struct, frozen=True):
    """Somebody may come in: the request as it goes on, and who it is."""

    head: RequestHead
    visitor: Visitor


class Gate:
    """Who may come in, and who is in."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        limits: GatewayLimits,
        state: Path | None,
        now_ns: Callable[[], int],
        doorway: Doorway | None = None,
    ) -> None:
        """`state`: where it is kept; without it no password can be set."""
        self._loop = loop
        self._limits = limits
        self._state = state
        self.now_ns = now_ns
        self._boot = clock.boot_id()
        self.people: People | files.Unreadable = People()
        self._stamp: object = None
        self._looked_ns = 0
        self.doorway = doorway or Doorway()
        self._proxies = Proxies(self.doorway.proxies)
        spans = Spans(
            limits.session_idle_ms * _MS, limits.session_longest_ms * _MS, limits.session_proven_ms * _MS
        )
        before = files.read_sessions(state, self._boot) if state is not None else ()
        self.sessions = Sessions(spans, before)
        self.sessions.changed = self._keep_soon
        self._keeping: asyncio.Task[None] | None = None
        self._changed = False
        self.look()

    @property
    def closed(self) -> bool:
        """Whether one has to sign in."""
        return isinstance(self.people, files.Unreadable) or self.people.closed

    # -- who comes -------------------------------------------------------------------------------------

    def enters(self, exchange: Exchange, way: Route) -> Problem | None:
        """Let a request in, as who it is; or say why not."""
        made = self.entry(exchange.head, exchange.client.address, way)
        if isinstance(made, Problem):
            return made
        exchange.head, exchange.visitor = made.head, made.visitor
        return None

    def entry(self, head: RequestHead, address: str, way: Route) -> Entered | Problem:
        """Who asks, and the request as it goes on; or why it does not."""
        came = self.client(head, address)
        at_home = address == AT_HOME
        near = is_near(address) and not head.forwarded
        # A door that was never opened, or whose file can't be read, leads to nobody beyond this machine.
        beyond = not is_near(address) and not self.doorway.open
        if came.refused or (beyond and self.closed):
            return Problem.AROUND_THE_PROXY
        if at_home or not self.closed:
            # A password that was taken away again must not open the door to a whole network.
            served = near or not (self.doorway.open or beyond)
            return Entered(head, THE_OWNER) if served else Problem.NO_PASSWORD_SET
        if way in PUBLIC:
            return Entered(head, THE_OWNER)
        if isinstance(self.people, files.Unreadable):
            return Problem.ACCESS_UNREADABLE
        now_ns = self.now_ns()
        visitor = visitor_of(head, self.people, self.sessions, now_ns, https=came.https)
        if visitor is Problem.TOKEN_WRONG and self._looks_anew(now_ns) and isinstance(self.people, People):
            visitor = visitor_of(head, self.people, self.sessions, now_ns, https=came.https)
        if isinstance(visitor, Problem):
            return visitor
        if (problem := judged(visitor, head, way)) is not None:
            return problem
        if visitor.session is not None and way is not Route.STATUS:  # a page asks that by itself
            visitor.session.seen_ns = now_ns
        own = ((b"X-Actor", visitor.name.encode()),)
        return Entered(without_credentials(head, own), visitor)

    def _looks_anew(self, now_ns: int) -> bool:
        """Look whether a strange token was made this moment: a script should not have to wait. Not for whoever guesses."""
        if now_ns - self._looked_ns < _LOOK_AGAIN_NS:
            return False
        self._looked_ns = now_ns
        return contained("looking who may come in", self.look)

    def client(self, head: RequestHead, address: str) -> Client:
        """Where a request comes from, behind whatever stands before us."""
        tls = bool(self.doorway.tls_cert)
        if self._proxies:
            behind = self._proxies.client(address, head.forwarded_for, head.forwarded_proto)
            if behind is not None:
                return behind
        around = bool(self._proxies) and not (tls or self.doorway.insecure_lan or is_near(address))
        return Client(address, tls, refused=around and self.doorway.open)

    def streams(self, head: RequestHead, address: str) -> bool:
        """Whether a body is passed on as it comes and not kept: it is long, or of somebody who may not come in."""
        long = (head.content_length or 0) > self._limits.replay_body_bytes_max
        return long or (head.content_length != 0 and self._is_stranger(head, address))

    def _is_stranger(self, head: RequestHead, address: str) -> bool:
        if not self.closed or address == AT_HOME:
            return False
        if head.path in GATE_PATHS:
            return head.content_length is None or head.content_length > FORM_BYTES_MAX
        if isinstance(self.people, files.Unreadable):
            return True
        https = self.client(head, address).https
        found = visitor_of(head, self.people, self.sessions, self.now_ns(), https=https)
        return isinstance(found, Problem)

    def is_open(self, session: Session | None) -> bool:
        """Whether whoever came in with this session is still in. None: he needed none."""
        if session is None:
            return True
        people = self.people
        return isinstance(people, People) and self.sessions.is_open(session, people, self.now_ns())

    def refusal(self, problem: Problem, head: RequestHead) -> pages.Answer:
        """What somebody is told who may not come in, where no page of ours is asked for."""
        extra = ((b"WWW-Authenticate", b"Bearer"),) if problem is Problem.TOKEN_WRONG else ()
        made = pages.problem(problem, head.accept_language)
        return pages.with_headers(made, extra)

    # -- what is kept ----------------------------------------------------------------------------------

    def upkeep(self) -> None:
        """Now and then: see whether who may come in has changed, and forget sessions that are over."""
        now_ns = self.now_ns()
        if now_ns - self._looked_ns >= self._limits.access_look_ms * _MS:
            self._looked_ns = now_ns
            contained("looking who may come in", self.look)
            if isinstance(self.people, People):
                self.sessions.prune(self.people, now_ns)

    def look(self) -> None:
        """Read who may come in, if that was written since."""
        if self._state is None:
            return
        try:
            told = (self._state / files.PEOPLE).stat()
            stamp: object = (told.st_ino, told.st_mtime_ns, told.st_size)
        except FileNotFoundError:
            stamp = None
        if stamp != self._stamp:
            self.people, self._stamp = files.read_people(self._state), stamp

    async def change_people(
        self, change: Callable[[People], People | None]
    ) -> People | files.Unreadable | None:
        """Change who may come in (see `files.change_people`). OSError where the disk refuses it."""
        assert self._state is not None, "nobody is invited where nothing is kept"
        changed = await self._loop.run_in_executor(None, files.change_people, self._state, change)
        self.look()
        return changed

    def _keep_soon(self) -> None:
        self._changed = True
        if self._state is not None and self._keeping is None:
            self._keeping = self._loop.create_task(self._keep(self._state))

    async def _keep(self, state: Path) -> None:
        """Write who is signed in: for the next gateway. Where the disk refuses it, they sign in again then."""
        while self._changed:
            self._changed = False
            kept = tuple(self.sessions)
            try:
                await self._loop.run_in_executor(None, files.write_sessions, state, self._boot, kept)
            except OSError:
                break
        self._keeping = None

    async def finish(self) -> None:
        """The gateway ends: the last times of use are kept too."""
        if self.closed:
            self._keep_soon()
        if self._keeping is not None:
            await self._keeping
