"""Where a request goes: to the core, into the waiting room, to a page of our own, or back.

A few lines of a table rather than a router: the gateway owns the health paths and what stands under `/__hc/`,
and everything else belongs to the core. The face is asked after the path, because our own pages answer in every phase.
"""

from enum import Enum
from typing import assert_never

from hardcore.model.phases import Face


class Route(Enum):
    """What happens to a request at the door."""

    LIVE = "answer whether the guard is alive"
    READY = "answer whether a core may be sent traffic"
    STARTUP = "answer whether the first start is over"
    HEALTH = "answer how everything is"
    METRICS = "answer with the numbers"
    STATUS = "answer how things stand"
    OWN = "answer with a file or a page of our own"
    RECEIPT = "tell of a promise, take one up, or hear a person's word on it"
    ADMIN = "pass it on to the investigators"
    GATE = "sign somebody in or out"
    DRILL = "ask the guard to break the core, in a demo"
    FORWARD = "send it to the serving core"
    HOLD = "keep it until a core serves"
    REFUSE = "answer at once that nobody knows when a core comes"
    CLOSE = "answer at once that the service is being stopped"


#: The doors: what monitors ask. They are answered from memory, whatever else is going on.
DOORS = {
    b"/livez": Route.LIVE,
    b"/readyz": Route.READY,
    b"/startupz": Route.STARTUP,
    b"/health": Route.HEALTH,
    b"/metrics": Route.METRICS,
}
OWN_PAGES = {**DOORS, b"/__hc/status.json": Route.STATUS}
#: Everything under it is the gateway's; a core never sees it.
OWN_PREFIX = b"/__hc/"
DRILL_PREFIX = b"/__hc/drill/"
RECEIPT_PREFIX = b"/__hc/receipts/"
KEEP_PATH = b"/__hc/keep"
SIGN_IN_PATH = b"/__hc/sign-in"
SIGN_OUT_PATH = b"/__hc/sign-out"
INVITED_PATH = b"/__hc/invited"
ME_PATH = b"/__hc/me"
GATE_PATHS = frozenset({SIGN_IN_PATH, SIGN_OUT_PATH, INVITED_PATH, ME_PATH})
#: The investigators' pages, and everything under them.
ADMIN_PATH = b"/admin"


def is_admin(path: bytes) -> bool:
    """Whether a path is the investigators'."""
    return path.startswith(ADMIN_PATH) and path[len(ADMIN_PATH) :][:1] in {b"", b"/"}


def route(path: bytes, posture: Face, *, leaving: bool) -> Route:
    """The way of a request for `path`. `leaving`: the gateway itself is being stopped."""
    if (own := OWN_PAGES.get(path)) is not None:
        return own
    if path.startswith(OWN_PREFIX):
        if path == KEEP_PATH or path.startswith(RECEIPT_PREFIX):
            return Route.RECEIPT
        if path in GATE_PATHS:
            return Route.GATE
        return Route.DRILL if path.startswith(DRILL_PREFIX) else Route.OWN
    if is_admin(path):
        return Route.ADMIN
    if leaving:
        return Route.CLOSE
    match posture:
        case Face.FORWARD:
            return Route.FORWARD
        case Face.HOLD:
            return Route.HOLD
        case Face.REFUSE:
            return Route.REFUSE
        case Face.CLOSED:
            return Route.CLOSE
        case _:
            assert_never(posture)
