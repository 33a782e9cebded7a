"""The witness of the two beats: one from the event loop, one from a thread beside it.

The pair is the diagnosis: both stale, the process or its GIL stands still; only the loop's stale, the loop
is blocked. A beat carries the time it was made at, and both clocks are the same machine's, so its age is
a difference, not an arrival. A late beat alone is never a verdict.

Which of the two comes first after a held GIL is chance. A look that falls in between sees a fresh thread and
a loop that has been silent for long, and nothing is wrong any more: so the thread must have gone on alone in
two looks before that counts.
"""

import msgspec

from hardcore.model.recorder import Beats
from hardcore.model.verdicts import Colour, Testimony
from hardcore.sentinel.lasting import NS_PER_MS
from hardcore.sentinel.seen_time import SeenTime


class BeatAges(msgspec.Struct, frozen=True):
    """How long ago each beat was made, in ns, as far as we were there to see."""

    loop_ns: int
    thread_ns: int
    last_loop_ns: int

    def loop_stale(self, limit_ms: int) -> bool:
        """Return whether the loop's beat is older than `limit_ms`."""
        return self.loop_ns > limit_ms * NS_PER_MS

    def thread_stale(self, limit_ms: int) -> bool:
        """Return whether the thread's beat is older than `limit_ms`."""
        return self.thread_ns > limit_ms * NS_PER_MS


class LoneThread(msgspec.Struct):
    """Counts the looks in a row in which the thread's beat went on and the loop's did not."""

    looks: int = 0
    _loop_ns: int = 0
    _thread_ns: int = 0

    def look(self, beats: Beats) -> bool:
        """Take in one look; return whether two in a row agree that the loop alone stands still."""
        alone = beats.loop_ns == self._loop_ns and beats.thread_ns != self._thread_ns
        self._loop_ns, self._thread_ns = beats.loop_ns, beats.thread_ns
        self.looks = self.looks + 1 if alone else 0
        return self.looks >= 2


def ages(beats: Beats, seen: SeenTime) -> BeatAges:
    """Return the ages of both beats at this look."""
    return BeatAges(seen.since(beats.loop_ns), seen.since(beats.thread_ns), beats.loop_ns)


def testify(found: BeatAges, limit_ms: int) -> Testimony:
    """Return what the beats say. Never red: lateness alone is no verdict."""
    late = [
        f"the {name}'s last beat is {age // NS_PER_MS} ms old"
        for name, age, stale in (
            ("loop", found.loop_ns, found.loop_stale(limit_ms)),
            ("thread", found.thread_ns, found.thread_stale(limit_ms)),
        )
        if stale
    ]
    if late:
        return Testimony("beats", Colour.YELLOW, "; ".join(late))
    return Testimony("beats", Colour.GREEN, "both beats are fresh")
