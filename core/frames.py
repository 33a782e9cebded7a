"""Frames: the words in which an open page hears of the book (`docs/wires.md` section 8).

Pure functions from what happened to the text that is sent. A frame says that something changed and what it was
called, never an amount: a page that shows money asks for it, so that there is one way to read the book and no
second truth on the wire.
"""

from collections.abc import Sequence
from typing import Any, Final

import msgspec

from core.hub import Frame, Hub
from core.ledger.events import Event
from core.ledger.views import CommittedEvent, tell

VERSION: Final = 1
MISSED_EVENTS_MAX: Final = 500


def frame_of(event: CommittedEvent) -> Frame:
    """Return the frame that tells of an event."""
    if event.date is None:
        return Frame(_text("ledger.account", seq=event.seq, id=event.id), event.seq)
    text = _text(
        "ledger.transaction",
        seq=event.seq,
        id=event.id,
        date=event.date,
        description=event.description,
        accounts=event.accounts,
    )
    return Frame(text, event.seq)


def hello(seq: int, epoch: int) -> Frame:
    """Return the first frame: the events told from now on come after `seq`."""
    return Frame(_text("ledger.hello", seq=seq, epoch=epoch))


def resync(seq: int) -> Frame:
    """Return the frame that says: more was missed than is told; read anew, as of `seq`."""
    return Frame(_text("ledger.resync", seq=seq))


def progress(
    import_id: str, state: str, done: int, total: int, duplicates: int, refused: int, waiting: str | None
) -> Frame:
    """Return the frame that says how far an import is; the numbers count rows of its file.

    `waiting`: why it does not go on at this moment; None: it does.
    """
    counted = {"done": done, "total": total, "duplicates": duplicates, "refused": refused}
    return Frame(_text("import.progress", id=import_id, state=state, waiting=waiting, **counted))


def catch_up(after: int | None, head: int, missed: Sequence[CommittedEvent]) -> list[Frame]:
    """Return what a socket that saw everything up to `after` is told of what came until `head`.

    `missed`: the first events after `after`, one more than are told if there are so many. An `after` past the
    head comes from another book, or from one that was taken back: nothing it saw can be relied upon.
    """
    if after is None or after == head:
        return []
    if after > head or len(missed) > MISSED_EVENTS_MAX:
        return [resync(head)]
    return [frame_of(one) for one in missed if one.seq <= head]


def tell_committed(hub: Hub, events: Sequence[tuple[int, Event]]) -> None:
    """Tell what the writer has committed, each event with its number; costs nothing while nobody listens."""
    if hub.listeners:
        hub.tell([frame_of(tell(event, seq)) for seq, event in events])


def _text(kind: str, **members: Any) -> str:
    return msgspec.json.encode({"v": VERSION, "type": kind, **members}).decode()
