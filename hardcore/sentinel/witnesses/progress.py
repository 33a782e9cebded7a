"""The witness of progress: do commands that wait get done?

Beats prove that the loop turns, not that anything comes of it. This witness looks at the commands that the
writer has not taken up: one that has been QUEUED for long while the writer neither decides nor is in the
store, and its thread is asleep or gone, will wait for ever. A command that is being decided or written is
somebody else's matter (a slow transaction, a slow store): never a reason to call the core stuck. Nor is a
read that waits behind slow reads: the writer sleeps then because nobody wants anything of it.
"""

import msgspec

from hardcore.model.recorder import Beats, CommandNote, SlotStage
from hardcore.model.verdicts import Colour, Testimony
from hardcore.sentinel.lasting import NS_PER_MS
from hardcore.sentinel.seen_time import SeenTime

_TAKEN = frozenset({SlotStage.DECIDING, SlotStage.WRITING, SlotStage.COMMITTED})


class Progress(msgspec.Struct):
    """Remembers since when nothing was completed."""

    _completed: int = -1
    _since_ns: int = 0

    def look(self, beats: Beats, in_flight: tuple[CommandNote, ...] | None, seen: SeenTime) -> "Stuck | None":
        """Return what waits without being taken up, or None when everything moves."""
        if beats.completed != self._completed or not beats.waiting:
            self._completed, self._since_ns = beats.completed, seen.at_ns
            return None
        if not in_flight or beats.in_store_since_ns:
            return None
        writes = [note for note in in_flight if not note.kind.startswith("read")]
        if any(note.stage in _TAKEN for note in writes):
            return None
        queued = [note for note in writes if note.stage is SlotStage.QUEUED and not note.torn]
        if not queued:
            return None
        began_ns = max(self._since_ns, min(note.stage_ns for note in queued))
        return Stuck(len(queued), seen.since(began_ns), began_ns)


class Stuck(msgspec.Struct, frozen=True):
    """Commands that wait while nothing is done: how many, for how long (ns), since when."""

    queued: int
    for_ns: int
    since_ns: int


def testify(stuck: Stuck | None, limit_ms: int) -> Testimony:
    """Return what the queue says; yellow from `limit_ms` on."""
    if stuck is None or stuck.for_ns < limit_ms * NS_PER_MS:
        return Testimony("progress", Colour.GREEN, "nothing waits for long")
    return Testimony(
        "progress",
        Colour.YELLOW,
        f"{stuck.queued} commands wait and none was completed for {stuck.for_ns // NS_PER_MS} ms",
    )
