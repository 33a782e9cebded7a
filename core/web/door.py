"""The door: what happens to every request and every answer, around the whole application.

Each answer says the epoch it comes from, so that a gateway can discard the answers of a core that is no longer
the serving one; each slot that a request took is given back with the status that went out, whatever happened
in between. It is a plain ASGI layer: the framework's own middleware class costs a task per request.
"""

from typing import Final

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from core.journal.answers import Commit
from core.service import Service
from core.slots import UNANSWERED

_SLOT: Final = "core.slot"
_COMMIT: Final = "core.commit"
_FAILED: Final = 400
_SWITCHING: Final = 101
_HEADS: Final = frozenset({"http.response.start", "websocket.accept", "websocket.http.response.start"})


def take_slot(scope: Scope, slot: int) -> None:
    """Bind a slot to this request: it is finished when the request is."""
    assert _SLOT not in scope, "a request takes one slot"
    scope[_SLOT] = slot


def note_commit(scope: Scope, commit: Commit) -> None:
    """Have the answer to this request say what it has booked; the last of several."""
    scope[_COMMIT] = commit


class Door:
    """Stamps answers with the epoch and gives slots back."""

    def __init__(self, app: ASGIApp, service: Service) -> None:
        self._app = app
        self._service = service
        self._epoch = str(service.epoch).encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request through."""
        status = UNANSWERED

        async def stamp(message: Message) -> None:
            nonlocal status
            if message["type"] in _HEADS:
                await self._service.still_ours()
                status = message.get("status", _SWITCHING)
                message["headers"] = [*message.get("headers", ()), (b"x-core-epoch", self._epoch)]
                if _COMMIT in scope and status < _FAILED:
                    said = f"{scope[_COMMIT].seq}:{scope[_COMMIT].hash.hex()}".encode()
                    message["headers"].append((b"x-core-commit", said))
                if _SLOT in scope:
                    self._service.answering(scope[_SLOT])
            await send(message)

        try:
            await self._app(scope, receive, stamp)
        finally:
            if _SLOT in scope:
                self._service.finish(scope[_SLOT], status)
