"""A bug of ours with one socket: it ends that one, and leaves nothing behind that nobody looks after."""

import asyncio
import socket
import time
from types import SimpleNamespace
from typing import Any, cast

from hardcore.crisis.burden import Burden
from hardcore.crisis.census import Census
from hardcore.crisis.gate import Gate
from hardcore.crisis.heads import RequestHead, read_request
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.live import LIVE_PATH, Live
from hardcore.crisis.outlook import Outlook
from hardcore.crisis.sockets import Sockets
from hardcore.crisis.tunnel import Tunnel


class OurError(Exception):
    """Whatever it was."""


class Faulty:
    """Fails at each touch; remembers that it was cut."""

    def __init__(self, head: RequestHead | None = None) -> None:
        self.head = head
        self.cut_now = asyncio.Event()

    def learn(self, *_: object) -> None:
        raise OurError

    join = learn

    def cut(self) -> None:
        self.cut_now.set()


def _head(path: bytes) -> RequestHead:
    lines = (
        (b"Host", b"localhost"),
        (b"Connection", b"Upgrade"),
        (b"Upgrade", b"websocket"),
        (b"Sec-WebSocket-Version", b"13"),
        (b"Sec-WebSocket-Key", b"AAAAAAAAAAAAAAAAAAAAAA=="),
    )
    head = read_request("GET", path, "1.1", lines, {"localhost"}, keep_alive=True, upgrade=True)
    assert isinstance(head, RequestHead)
    return head


def _sockets(live: object = None) -> Sockets:
    serving = SimpleNamespace(epoch=1, socket="/nowhere/core.sock")
    outlook: Any = SimpleNamespace(standing=SimpleNamespace(serving=serving))
    loop = asyncio.get_running_loop()
    limits, now_ns = GatewayLimits(), time.monotonic_ns
    gate = Gate(loop, limits, None, now_ns)
    return Sockets(loop, cast("Outlook", outlook), cast("Live", live), limits, now_ns, gate)


def test_a_bug_with_a_core_that_cannot_be_reached_ends_that_socket() -> None:
    async def play() -> None:
        tunnel = Faulty(_head(b"/ws"))
        _sockets().dial(cast("Tunnel", tunnel), b"/ws")
        await asyncio.wait_for(tunnel.cut_now.wait(), 20)

    asyncio.run(play())


def test_a_bug_at_a_sockets_beginning_ends_its_connection() -> None:
    asyncio.run(_begin_badly())


async def _begin_badly() -> None:
    loop = asyncio.get_running_loop()
    ours, theirs = socket.socketpair()
    theirs.setblocking(False)
    transport, _ = await loop.connect_accepted_socket(asyncio.Protocol, ours)
    census = Census(set(), time.monotonic_ns, lambda: None, Burden(0))
    sockets = _sockets(Faulty())
    sockets.arrived(transport, _head(LIVE_PATH), census, "127.0.0.1")
    with theirs:
        assert await asyncio.wait_for(loop.sock_recv(theirs, 1), 20) == b""
    assert not census.connections
    assert len(sockets) == 0
