"""The gateway's end of the feed: dials the sentinel, hears its lines, says ours, dials again when it dies.

The sentinel may be restarted at any time; nothing here waits for it, and while nobody listens lines are
refused rather than queued: what must not be lost (`served`, `holding`) is said again by whoever said it,
what became of requests is kept here up to a bound, and a number that nobody heard is stale anyway.
"""

import asyncio
import logging
from collections import deque
from collections.abc import Callable
from typing import cast

from hardcore.crisis.feed import Heard, LineSplitter, Unreadable, parse_line, subscribe_line
from hardcore.crisis.limits import GatewayLimits

_LOG = logging.getLogger(__name__)

#: Unread bytes above which the sentinel counts as not listening (it may be frozen).
UNREAD_BYTES_MAX = 1 << 20
#: Lines kept for a sentinel that is not there.
KEPT_LINES_MAX = 256


class _Wire(asyncio.Protocol):
    """One connection to the sentinel."""

    def __init__(self, link: "FeedLink") -> None:
        self.transport: asyncio.Transport | None = None
        self._link = link
        self._splitter = LineSplitter()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast("asyncio.Transport", transport)
        self._link.joined(self)

    def data_received(self, data: bytes) -> None:
        lines = self._splitter.feed(data)
        if lines is None:
            _LOG.warning("the feed said a line that is too long; dialling again")
            self.hang_up()
            return
        for line in lines:
            message = parse_line(line)
            if isinstance(message, Unreadable):
                _LOG.warning("the feed said a line that cannot be read: %s", message.why)
            else:
                self._link.heard(message)

    def connection_lost(self, exc: Exception | None) -> None:
        del exc  # a sentinel that left is dialled again, whatever the reason
        self.transport = None
        self._link.parted(self)

    def hang_up(self) -> None:
        if self.transport is not None:
            self.transport.abort()


class FeedLink:
    """Keeps one connection to the sentinel open."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        path: str,
        pid: int,
        limits: GatewayLimits,
    ) -> None:
        self.heard: Callable[[Heard], None] = lambda _: None
        self._loop = loop
        self._path = path
        self._pid = pid
        self._retry_s = limits.feed_retry_ms / 1000
        self._wire: _Wire | None = None
        self._kept: deque[bytes] = deque(maxlen=KEPT_LINES_MAX)
        self._dial: asyncio.Task[None] | None = None
        self._again: asyncio.TimerHandle | None = None
        self._closed = False

    def start(self, heard: Callable[[Heard], None]) -> None:
        """Dial; every message goes to `heard`."""
        self.heard = heard
        self._call()

    def _call(self) -> None:
        self._again = None
        if not self._closed:
            self._dial = self._loop.create_task(self._connect())

    async def _connect(self) -> None:
        try:
            await self._loop.create_unix_connection(lambda: _Wire(self), self._path)
        except OSError:
            self._dial_later()

    def _dial_later(self) -> None:
        if not self._closed and self._again is None:
            self._again = self._loop.call_later(self._retry_s, self._call)

    def joined(self, wire: _Wire) -> None:
        """The sentinel took the call."""
        self._wire = wire
        self.say(subscribe_line(self._pid))
        while self._kept:
            self.say(self._kept.popleft())

    def parted(self, wire: _Wire) -> None:
        """The sentinel is gone."""
        if wire is self._wire:
            self._wire = None
        self._dial_later()

    def say(self, line: bytes) -> bool:
        """Say a line; False if nobody listens."""
        wire = self._wire
        if wire is None or wire.transport is None or wire.transport.is_closing():
            return False
        if wire.transport.get_write_buffer_size() > UNREAD_BYTES_MAX:
            wire.hang_up()
            return False
        wire.transport.write(line)
        return True

    def say_or_keep(self, line: bytes) -> None:
        """Say a line now or to the next sentinel that listens."""
        if not self.say(line):
            self._kept.append(line)

    def close(self) -> None:
        """Say what was said, and dial no more."""
        self._closed = True
        if self._again is not None:
            self._again.cancel()
        if self._wire is not None and self._wire.transport is not None:
            self._wire.transport.close()
