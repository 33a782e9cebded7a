"""The hub: what the book has just done, told at once to everyone who listens.

Each listener has a seat with a bounded line of frames. Nobody waits for anybody: a listener that does not take
its frames loses its seat, and comes back to the book itself with the last sequence it saw. Frames are encoded
once for all seats. A broadcast that waits for its slowest reader was not chosen, and neither was one without a
bound: the first lets a sleeping telephone stop the household, the second lets it fill the memory.
"""

import asyncio
from collections import deque
from collections.abc import Sequence
from typing import Final

import msgspec

from core.journal.writer import BATCH_MAX
from core.ledger.decider import EVENTS_PER_COMMAND_MAX

SEATS_MAX: Final = 512
# A whole batch of the writer is told at once; the rest is for a listener that pauses.
WAITING_FRAMES_MAX: Final = BATCH_MAX * EVENTS_PER_COMMAND_MAX + 1_000


class Frame(msgspec.Struct, frozen=True):
    """One text for every listener. `seq`: the event it tells of, None where it tells of none."""

    text: str
    seq: int | None = None


class Seat:
    """One listener's line of frames. Used on the loop's thread."""

    def __init__(self) -> None:
        self._waiting: deque[Frame] = deque()
        self._changed = asyncio.Event()
        self._lost = asyncio.Event()

    def give(self, frames: Sequence[Frame]) -> bool:
        """Put frames in the line; False where it is full: the seat is lost and holds nothing any more."""
        if len(self._waiting) + len(frames) > WAITING_FRAMES_MAX:
            self._waiting.clear()
            self._lost.set()
            return False
        self._waiting.extend(frames)
        self._changed.set()
        return True

    async def take(self) -> list[Frame]:
        """Wait for frames and take all that wait. A seat that is lost has none for ever."""
        await self._changed.wait()
        self._changed.clear()
        taken = list(self._waiting)
        self._waiting.clear()
        return taken

    async def lost(self) -> None:
        """Wait until the seat is lost."""
        await self._lost.wait()


class Hub:
    """All seats. Used on the loop's thread."""

    def __init__(self) -> None:
        self._seats: set[Seat] = set()

    @property
    def listeners(self) -> int:
        """How many seats are taken."""
        return len(self._seats)

    def sit(self) -> Seat | None:
        """Take a seat, or None where all are taken. Each seat must be given to `leave`."""
        if len(self._seats) >= SEATS_MAX:
            return None
        seat = Seat()
        self._seats.add(seat)
        return seat

    def leave(self, seat: Seat) -> None:
        """Give a seat back; a lost one may be given back as well."""
        self._seats.discard(seat)

    def tell(self, frames: Sequence[Frame]) -> None:
        """Tell everyone, in order; whoever has not taken what was told before loses the seat."""
        for seat in [seat for seat in self._seats if not seat.give(frames)]:
            self._seats.discard(seat)
