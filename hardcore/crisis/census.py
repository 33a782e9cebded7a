"""Who is connected: what all connections of clients share, whatever protocol they speak, and how many come from where.

One address may have most of the places and never all of them: whoever floods from a device at home leaves room for
the other devices. What clients leave unread is weighed here too, all of them together (see `burden`).
"""

import asyncio
import socket
from collections.abc import Callable, Collection
from typing import Protocol

import msgspec

from hardcore.crisis.burden import Burden
from hardcore.crisis.limits import GatewayLimits

#: The address of whoever has none, or takes no place of its own.
NOWHERE = ""
#: The address of whoever came by the socket that only the owner of the data may open.
AT_HOME = "at home"


class Caller(Protocol):
    """One that came when it was full, and may still ask a door."""

    def give_back(self) -> None:
        """It has been heard for long enough: turn it away."""


class Guest(Protocol):
    """One open connection."""

    def depart(self) -> None:
        """The gateway leaves: end now if nothing is going on, else as soon as it is over."""


def address_of(transport: asyncio.BaseTransport) -> str:
    """The address at the other end."""
    peer = transport.get_extra_info("peername")
    if transport.get_extra_info("socket").family == socket.AF_UNIX:
        return AT_HOME
    return str(peer[0]) if isinstance(peer, tuple) and peer else NOWHERE


def is_near(address: str) -> bool:
    """Whether an address is one of this machine itself."""
    return address.removeprefix("::ffff:").startswith("127.") or address in {"::1", AT_HOME}


class Census(msgspec.Struct):
    """Who is open, and the names this server answers to. `changed` is called when somebody comes or leaves."""

    hosts: Collection[str]
    now_ns: Callable[[], int]
    changed: Callable[[], None]
    unread: Burden  # answers that were written and not taken
    door_callers: dict[Caller, None] = msgspec.field(default_factory=dict)  # the longest silent one first
    connections: dict[Guest, str] = msgspec.field(default_factory=dict)  # and their addresses
    _by_address: dict[str, int] = msgspec.field(default_factory=dict)

    def enter(self, guest: Guest, address: str) -> None:
        """One more."""
        self.connections[guest] = address
        self._by_address[address] = self._by_address.get(address, 0) + 1
        self.changed()

    def leave(self, guest: Guest) -> None:
        """One less, if it was there."""
        address = self.connections.pop(guest, None)
        if address is None:
            return
        left = self._by_address.pop(address) - 1
        if left:
            self._by_address[address] = left
        self.changed()

    def is_full(self, address: str, limits: GatewayLimits) -> bool:
        """Whether there is no place for one more from this address."""
        mine = self._by_address.get(address, 0) if address != NOWHERE else 0
        return len(self.connections) >= limits.connections_max or mine >= limits.connections_per_address_max

    def is_crowded(self, limits: GatewayLimits) -> bool:
        """Whether even those who are turned away are too many to be heard out."""
        return len(self.connections) >= limits.connections_max + limits.turned_away_max
