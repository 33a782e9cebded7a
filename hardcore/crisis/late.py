"""A caller who came when every place was taken, and may still ask one of the doors.

A monitor that is turned away by a flood would call a machine dead that is only busy, and what it then does is worse than
the flood. So a few connections above the limit are heard out for one head, and no longer than a moment: who asks a
door is answered and leaves; anybody else is told what all are told who find no place. When those few are too many as
well, the one that has been silent longest makes room: a monitor speaks as soon as it is let in. Places that are kept free
for this machine's own addresses were not chosen: the flood may come from there as well.
"""

import asyncio
from typing import Protocol, cast

from hardcore.crisis.alarm import Alarm
from hardcore.crisis.census import Census, address_of
from hardcore.crisis.doors import DOOR_ROUTES, Doors
from hardcore.crisis.heads import RequestHead
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.parsing import RequestParser
from hardcore.crisis.problems import Problem
from hardcore.crisis.routing import OWN_PAGES
from hardcore.crisis.turns import whole_bytes

#: Read at a time; one buffer for all, because each piece is copied out before the next.
_SCRATCH = memoryview(bytearray(4 << 10))


class Owner(Protocol):
    """The connection that found no place."""

    loop: asyncio.AbstractEventLoop

    def turn_away(self, *, linger: bool) -> None:
        """Tell that there is no place, and end."""

    def connection_lost(self, exc: Exception | None) -> None:
        """It is gone."""


class LateCaller(asyncio.BufferedProtocol):
    """Hears one head. Whoever asks no door is given back to its owner, who turns it away."""

    def __init__(self, owner: Owner, doors: Doors, census: Census, limits: GatewayLimits) -> None:
        self._doors = doors
        self._census = census
        self._limits = limits
        self._owner = owner
        self._parser = RequestParser(self, census.hosts, limits.header_bytes_max)
        self._head: RequestHead | None = None
        self._over = False  # it was answered, or given back
        self._transport: asyncio.Transport | None = None
        self._alarm = Alarm(owner.loop, self._too_long)

    def take(self, transport: asyncio.BaseTransport) -> None:
        """Hear this one from now on, in the place of the longest silent one if there are too many."""
        callers = self._census.door_callers
        if len(callers) >= self._limits.door_callers_max:
            silent = next(iter(callers))
            del callers[silent]
            silent.give_back()
        callers[self] = None
        self._alarm.set(self._limits.door_head_ms)
        self._transport = cast("asyncio.Transport", transport)
        self._transport.set_protocol(self)

    # -- asyncio ---------------------------------------------------------------------------------------

    def get_buffer(self, sizehint: int) -> memoryview:
        """The one buffer for all of them."""
        del sizehint  # a head of a door is short
        return _SCRATCH

    def buffer_updated(self, nbytes: int) -> None:
        """Parse what came, until a head is whole."""
        if not self._over:
            self._parser.feed(bytes(_SCRATCH[:nbytes]))
            if self._head is not None:
                self._answer(self._head)

    def eof_received(self) -> bool:
        """Whoever says no more before a head is whole asks nothing."""
        self.give_back()
        return True

    def connection_lost(self, exc: Exception | None) -> None:
        """Let go of it."""
        self._leave()
        self._owner.connection_lost(exc)

    # -- parsing.Listener ------------------------------------------------------------------------------

    def headed(self, head: RequestHead) -> None:
        """A head is whole."""
        self._head = self._head or head

    def refused(self, problem: Problem, accept_language: str, *, no_body: bool) -> None:
        """It can't be read: it asks no door."""
        del problem, accept_language, no_body
        self.give_back()

    def came(self, data: bytes) -> None:
        """Pieces of a body are of no use to a door."""

    def whole(self) -> None:
        """The request is at its end."""

    # -- the two ends ----------------------------------------------------------------------------------

    def _answer(self, head: RequestHead) -> None:
        transport, way = self._transport, OWN_PAGES.get(head.path)
        if way not in DOOR_ROUTES or transport is None or transport.is_closing():
            self.give_back()
            return
        assert way is not None
        self._over = True
        self._census.door_callers.pop(self, None)
        answer = self._doors.answer(head, way, address_of(transport))
        transport.write(whole_bytes(head, answer.head, answer.body, close=True))
        transport.close()
        self._alarm.set(self._limits.door_head_ms)

    def give_back(self) -> None:
        """Turn it away as everybody else who finds no place."""
        transport = self._transport
        if self._over or transport is None or transport.is_closing():
            return
        self._leave()
        transport.set_protocol(cast("asyncio.BaseProtocol", self._owner))
        self._owner.turn_away(linger=not self._census.is_crowded(self._limits))

    def _too_long(self) -> None:
        """It says nothing, or does not take what it was told."""
        if self._over and self._transport is not None:
            self._transport.abort()
        else:
            self.give_back()

    def _leave(self) -> None:
        self._census.door_callers.pop(self, None)
        self._over, self._transport = True, None
        self._alarm.close()
