"""The sockets of open pages, on the server's side: a client takes what it is sent, or is hung up on.

A room of its own, because its library is large and no answer needs it: a core loads it when it serves already, and a
spare while it waits. Not chosen: to be patient with whoever does not read; what is sent to him stays in our memory.
"""

import asyncio
from typing import Final

from uvicorn._types import ASGISendEvent
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

STUCK_S: Final = 5.0


class PageSocket(WebSocketsSansIOProtocol):
    """A WebSocket whose client takes what it is sent, or is hung up on.

    Closing is not enough for one that reads nothing: the close frame would wait behind the rest.
    """

    _stuck: asyncio.TimerHandle | None = None

    async def send(self, message: ASGISendEvent) -> None:
        """Send, and know a refusal for an answer: the server takes it for a handshake that never ended."""
        await super().send(message)
        if self.initial_response is not None and self.close_sent:
            self.handshake_complete = True

    def pause_writing(self) -> None:
        """The client does not read: give it a while."""
        super().pause_writing()
        self._stuck = self.loop.call_later(STUCK_S, self._hang_up)

    def resume_writing(self) -> None:
        """It reads again."""
        self._forgive()
        super().resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        """It is gone."""
        self._forgive()
        super().connection_lost(exc)

    def _hang_up(self) -> None:
        self.transport.abort()

    def _forgive(self) -> None:
        if self._stuck is not None:
            self._stuck.cancel()
            self._stuck = None
