r"""The life of one browser's socket that leads to the core, as a table, and what it takes to go on after a death.

The browser's end outlives the core's: it is answered only once a core has accepted (so nobody is promised a
socket that leads nowhere), and then stays open over every death until somebody says otherwise. A socket is led
to at most one core at a time, which the table sees to: ASK is the only deed that opens one, and no row has it
while another is open. Closing and letting pages come back by themselves was not chosen: a page would see its
network fail in the very moment in which it has to explain what happened.

    WAITING <--NOT_TAKEN-- ASKING --ACCEPTED--> OPEN --CORE_LOST--> ORPHANED <--NOT_TAKEN-- RESUMING
       \------PASS---------->                     ^                     \-------PASS--------->  |
                                                  \-------------------ACCEPTED------------------/
"""

import json
from enum import Enum, auto
from urllib.parse import parse_qsl

#: The subprotocol whose frames have a `seq`, and which can therefore go on where it stopped.
RESUMABLE = "hardcore.v1"
#: Cores' ends of a socket that may be lost in one epoch: one core that drops it again and again is no core for it.
LOSSES_PER_EPOCH_MAX = 3
#: Codes with which a core says that it is only leaving: it did not mean this socket.
LEAVING_CODES = frozenset({1001, 1012})
#: Codes that may stand in a close frame, beside those of applications; others name what nobody said.
_SAYABLE = frozenset({1000, 1001, 1002, 1003, 1007, 1008, 1009, 1010, 1011, 1012, 1013, 1014})

NORMAL = 1000
GOING_AWAY = 1001
RESTARTED = 1012
TRY_LATER = 1013


class Line(Enum):
    """Where a socket is between its request and its end."""

    WAITING = auto()  # the browser's request is unanswered; no core is asked
    ASKING = auto()  # the browser's request is unanswered; a core is asked
    OPEN = auto()  # both ends are open
    ORPHANED = auto()  # the browser's end is open; the core is gone
    RESUMING = auto()  # the browser's end is open; the next core is asked
    OVER = auto()


class Pull(Enum):
    """What can happen to it."""

    PASS = auto()  # a released core takes sockets
    PASS_FOREIGN = auto()  # the same, but nobody knows how to go on with this one
    SPENT = auto()  # the same, but this core has dropped it too often
    ACCEPTED = auto()  # the core opened its end
    REFUSED = auto()  # the core said no
    BROKEN = auto()  # what answered is no core, or another one than was named
    NOT_TAKEN = auto()  # the core could not be reached, left, or ended before it answered
    CORE_LOST = auto()  # the core's end is gone
    CORE_CLOSED = auto()  # the core said that this socket is over
    TURN_AWAY = auto()  # no core is coming
    LIMIT = auto()  # its time is over
    LEAVE = auto()  # the gateway is being stopped
    LEFT = auto()  # the browser's end is gone


class Tug(Enum):
    """What the gateway does about it."""

    WAIT = auto()
    ASK = auto()
    OPEN = auto()  # answer the browser, and lead its end to the core's
    JOIN = auto()  # lead the browser's end to the new core's
    KEEP = auto()  # hold the browser's end
    PASS_REFUSAL = auto()
    SAY_BROKEN = auto()
    SAY_NOT_DONE = auto()
    SAY_LATE = auto()
    PASS_CLOSE = auto()
    END_RESTARTED = auto()
    END_LATER = auto()
    LET_GO = auto()
    NOTHING = auto()
    NEVER = auto()  # cannot happen: our own bug


def _row(line: Line, ways: dict[Pull, tuple[Line, Tug]]) -> dict[tuple[Line, Pull], tuple[Line, Tug]]:
    return {(line, pull): ways.get(pull, (line, Tug.NEVER)) for pull in Pull}


TABLE: dict[tuple[Line, Pull], tuple[Line, Tug]] = {
    **_row(
        Line.WAITING,
        {
            Pull.PASS: (Line.ASKING, Tug.ASK),
            Pull.SPENT: (Line.OVER, Tug.SAY_NOT_DONE),
            Pull.TURN_AWAY: (Line.OVER, Tug.SAY_NOT_DONE),
            Pull.LIMIT: (Line.OVER, Tug.SAY_NOT_DONE),
            Pull.LEAVE: (Line.OVER, Tug.SAY_NOT_DONE),
            Pull.LEFT: (Line.OVER, Tug.LET_GO),
        },
    ),
    **_row(
        Line.ASKING,
        {
            Pull.ACCEPTED: (Line.OPEN, Tug.OPEN),
            Pull.REFUSED: (Line.OVER, Tug.PASS_REFUSAL),
            Pull.BROKEN: (Line.OVER, Tug.SAY_BROKEN),
            Pull.NOT_TAKEN: (Line.WAITING, Tug.WAIT),
            Pull.CORE_LOST: (Line.WAITING, Tug.WAIT),
            Pull.LIMIT: (Line.OVER, Tug.SAY_LATE),
            Pull.LEAVE: (Line.OVER, Tug.SAY_NOT_DONE),
            Pull.LEFT: (Line.OVER, Tug.LET_GO),
        },
    ),
    **_row(
        Line.OPEN,
        {
            Pull.CORE_LOST: (Line.ORPHANED, Tug.KEEP),
            Pull.CORE_CLOSED: (Line.OVER, Tug.PASS_CLOSE),
            Pull.LEAVE: (Line.OVER, Tug.END_RESTARTED),
            Pull.LEFT: (Line.OVER, Tug.LET_GO),
        },
    ),
    **_row(
        Line.ORPHANED,
        {
            Pull.PASS: (Line.RESUMING, Tug.ASK),
            Pull.PASS_FOREIGN: (Line.OVER, Tug.END_RESTARTED),
            Pull.SPENT: (Line.OVER, Tug.END_LATER),
            Pull.LEAVE: (Line.OVER, Tug.END_RESTARTED),
            Pull.LEFT: (Line.OVER, Tug.LET_GO),
        },
    ),
    **_row(
        Line.RESUMING,
        {
            Pull.ACCEPTED: (Line.OPEN, Tug.JOIN),
            Pull.REFUSED: (Line.OVER, Tug.END_RESTARTED),
            Pull.BROKEN: (Line.OVER, Tug.END_RESTARTED),
            Pull.NOT_TAKEN: (Line.ORPHANED, Tug.KEEP),
            Pull.CORE_LOST: (Line.ORPHANED, Tug.KEEP),
            Pull.LIMIT: (Line.OVER, Tug.END_LATER),
            Pull.LEAVE: (Line.OVER, Tug.END_RESTARTED),
            Pull.LEFT: (Line.OVER, Tug.LET_GO),
        },
    ),
    # After the end everything comes too late, and is allowed to: connections end in any order.
    **{(Line.OVER, pull): (Line.OVER, Tug.NOTHING) for pull in Pull},
}

#: Lives in which a socket waits for a core.
WAITING = frozenset({Line.WAITING, Line.ORPHANED})


def when_released(line: Line, *, resumable: bool, losses: int) -> Pull:
    """What a released core means to a socket that waits. `losses`: in this core's epoch."""
    if losses >= LOSSES_PER_EPOCH_MAX:
        return Pull.SPENT
    return Pull.PASS if resumable or line is Line.WAITING else Pull.PASS_FOREIGN


def when_closed(code: int) -> Pull:
    """What it means that the core closed its end with `code`."""
    return Pull.CORE_LOST if code in LEAVING_CODES else Pull.CORE_CLOSED


def sayable(code: int | None, otherwise: int) -> int:
    """The code that tells one end how the other one ended."""
    return code if code is not None and (code in _SAYABLE or 3000 <= code < 5000) else otherwise


def seq_asked(target: bytes) -> int | None:
    """The `after` that a client asked for."""
    pairs = parse_qsl(target.partition(b"?")[2].decode("latin-1"))
    asked = next((value for name, value in pairs if name == "after"), "")
    return int(asked) if asked.isascii() and asked.isdigit() and len(asked) <= 18 else None


def seq_after(seen: int | None, frame: bytes) -> int | None:
    """How far a client has seen once it has `frame`. A `resync` begins anew, wherever that is."""
    if b'"seq"' not in frame:
        return seen
    try:
        said = json.loads(frame)
    except (ValueError, RecursionError):
        return seen
    seq = said.get("seq") if isinstance(said, dict) else None
    if isinstance(seq, bool) or not isinstance(seq, int):
        return seen
    return seq if seen is None or said.get("type") == "ledger.resync" else max(seen, seq)


def target_after(target: bytes, seen: int | None) -> bytes:
    """The path with which a socket goes on that has seen everything up to `seen` (None: nothing yet)."""
    if seen is None:
        return target
    path, _, query = target.partition(b"?")
    others = [pair for pair in query.split(b"&") if pair and pair.split(b"=", 1)[0] != b"after"]
    return path + b"?" + b"&".join([*others, b"after=%d" % seen])
