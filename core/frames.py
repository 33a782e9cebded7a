"""Frames: the words in which an open page hears of the book (`docs/wires.md` section 8).

Pure functions from what happened to the text that is sent. A frame says that something changed and what it was
called, never an amount: a page that shows money asks for it, so that there is one way to read the book and no
second truth on the wire.
"""

from collections.abc import Sequence
from typing import Any, Final

import msgspec

from core.hub import Frame
from core.journal.chain import EventRow

VERSION: Final = 1
MISSED_EVENTS_MAX: Final = 500


class Happened(msgspec.Struct, frozen=True):
    """What a frame needs to know of an event. `kind` is the event's; `date` is None where nothing was booked."""

    seq: int
    kind: str
    id: str
    date: str | None = None
    description: str = ""
    accounts: tuple[str, ...] = ()


class _Line(msgspec.Struct):
    account: str


class _Body(msgspec.Struct):
    id: str
    date: str | None = None
    description: str = ""
    postings: tuple[_Line, ...] = ()


_BODY: Final = msgspec.json.Decoder(_Body)


def happened(row: EventRow) -> Happened:
    """Return what a frame needs of a stored event, of whatever kind."""
    body = _BODY.decode(row.body)
    accounts = tuple(dict.fromkeys(line.account for line in body.postings))
    return Happened(row.seq, row.kind, body.id, body.date, body.description, accounts)


def frame_of(happened: Happened) -> Frame:
    """Return the frame that tells of an event."""
    if happened.date is None:
        return Frame(_text("ledger.account", seq=happened.seq, id=happened.id), happened.seq)
    text = _text(
        "ledger.transaction",
        seq=happened.seq,
        id=happened.id,
        date=happened.date,
        description=happened.description,
        accounts=happened.accounts,
    )
    return Frame(text, happened.seq)


def hello(seq: int, epoch: int) -> Frame:
    """Return the first frame: the events told from now on come after `seq`."""
    return Frame(_text("ledger.hello", seq=seq, epoch=epoch))


def resync(seq: int) -> Frame:
    """Return the frame that says: more was missed than is told; read anew, as of `seq`."""
    return Frame(_text("ledger.resync", seq=seq))


def progress(particulars: dict[str, Any]) -> Frame:
    """Return the frame that says how far an import is."""
    return Frame(_text("import.progress", **particulars))


def catch_up(after: int | None, head: int, missed: Sequence[Happened]) -> list[Frame]:
    """Return what a socket that saw everything up to `after` is told of what came until `head`.

    `missed`: the first events after `after`, one more than are told if there are so many. An `after` past the
    head comes from another book, or from one that was taken back: nothing it saw can be relied upon.
    """
    if after is None or after == head:
        return []
    if after > head or len(missed) > MISSED_EVENTS_MAX:
        return [resync(head)]
    return [frame_of(one) for one in missed if one.seq <= head]


def _text(kind: str, **members: Any) -> str:
    return msgspec.json.encode({"v": VERSION, "type": kind, **members}).decode()
