"""`WS /ws`: the book's own channel to an open page, from where the page left off.

A seat is taken before the book is asked what was missed, so nothing can fall between the two; what comes twice
is told once, by its sequence. Nothing is asked of the client and nothing it says is read: a channel that takes
commands would be a second door beside HTTP, without keys.
"""

import asyncio
import contextlib
from typing import Final

from starlette.websockets import WebSocket, WebSocketDisconnect

from core import frames
from core.frames import MISSED_EVENTS_MAX
from core.hub import Frame, Seat
from core.journal import queries
from core.journal.store import StoreError
from core.service import ReadTooLong, Service
from core.slots import Draining, NoSlot, holding_slot
from core.web.problems import Problem, respond
from core.web.same_origin import is_foreign
from frontend.render import language

SUBPROTOCOL: Final = "hardcore.v1"
RESTARTING: Final = 1012
TRY_AGAIN_LATER: Final = 1013
CLOSE_S: Final = 1.0  # a client that takes no frames is not waited for to take the last one either
SEQ_DIGITS_MAX: Final = 18


async def live(websocket: WebSocket) -> None:
    """WS /ws."""
    service: Service = websocket.app.state.service
    after = _after(websocket)
    refused = Problem("leaving") if service.draining else _refused(websocket, after)
    seat = service.hub.sit() if refused is None else None
    if seat is None:
        await _refuse(websocket, refused or Problem("busy"), service)
        return
    try:
        await websocket.accept(SUBPROTOCOL)
        await _until_over(websocket, service, seat, after if isinstance(after, int) else None)
    except WebSocketDisconnect:
        pass  # it left while it was being told something
    finally:
        service.hub.leave(seat)


async def _until_over(websocket: WebSocket, service: Service, seat: Seat, after: int | None) -> None:
    gone = asyncio.create_task(_gone(websocket))
    lost = asyncio.create_task(seat.lost())
    telling = asyncio.create_task(_tell(websocket, service, seat, after))
    try:
        await asyncio.wait({gone, lost, telling}, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in (gone, lost, telling):
            task.cancel()
        ends = await asyncio.gather(gone, lost, telling, return_exceptions=True)
    if gone.done() and not gone.cancelled():
        return
    failed = ends[2] if isinstance(ends[2], Exception) else None
    if failed is not None and not isinstance(failed, WebSocketDisconnect):
        raise failed
    code = ends[2] if isinstance(ends[2], int) else TRY_AGAIN_LATER
    with contextlib.suppress(TimeoutError):  # the server ends a connection that takes nothing
        await asyncio.wait_for(websocket.close(code), CLOSE_S)


async def _tell(websocket: WebSocket, service: Service, seat: Seat, after: int | None) -> int:
    """Tell what was missed and what happens from now on; return the code to close with when that ends."""
    head = service.head_seq
    missed = await _missed(service, after, head)
    if isinstance(missed, int):
        return missed
    last = head
    for frame in (frames.hello(head if after is None else min(after, head), service.epoch), *missed):
        await websocket.send_text(frame.text)
    while True:
        for frame in await seat.take():
            if frame.seq is None or frame.seq > last:
                last = frame.seq or last
                await websocket.send_text(frame.text)


async def _missed(service: Service, after: int | None, head: int) -> list[Frame] | int:
    """Return the frames of what was missed, or the code to close with where the book can't be asked."""
    if after is None or after >= head:
        return frames.catch_up(after, head, ())
    if any(after < seq <= head for seq in service.rulings.quarantine.rules.parked):
        return [frames.resync(head)]  # what is left out of every rebuild is not read for a frame either
    with holding_slot(service, "read.missed", b"after=%d" % after) as held:
        if isinstance(held, NoSlot):
            return TRY_AGAIN_LATER
        if isinstance(held, Draining):
            return RESTARTING
        one_more = MISSED_EVENTS_MAX + 1  # than are told: are there more?
        found = await service.read(held.slot, lambda c: queries.committed_after(c, after, one_more))
        if isinstance(found, ReadTooLong | StoreError):
            held.status = 503
            return TRY_AGAIN_LATER
        held.status = 200
        return frames.catch_up(after, head, found)


async def _gone(websocket: WebSocket) -> None:
    """Wait until the client has left; what it says meanwhile is not read."""
    while (await websocket.receive())["type"] != "websocket.disconnect":
        pass


def _after(websocket: WebSocket) -> int | Problem | None:
    given = websocket.query_params.get("after")
    if given is None:
        return None
    if given.isascii() and given.isdigit() and len(given) <= SEQ_DIGITS_MAX:
        return int(given)
    return Problem("invalid-parameter")


def _refused(websocket: WebSocket, after: int | Problem | None) -> Problem | None:
    if is_foreign(websocket):
        return Problem("foreign-page")
    if SUBPROTOCOL not in websocket.scope["subprotocols"]:
        return Problem("subprotocol-unknown", values={"subprotocol": SUBPROTOCOL})
    return after if isinstance(after, Problem) else None


async def _refuse(websocket: WebSocket, problem: Problem, service: Service) -> None:
    lang = language(websocket.headers.get("accept-language"))
    await websocket.send_denial_response(respond(problem, lang, service.settings))
