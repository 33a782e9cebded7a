"""The parts of the core that were started anew: which is under way, and which were too often.

One order at a time, because each changes what the beats of the others mean. A part that stands still again and again
is no part's matter any more: then another core is worth having. How often is counted in the policy's restart window, which is never shorter than it takes to see the
part stand still so often; and in one life a part is begun anew only so often in all, because each leaves a thread behind.
"""

import msgspec

from hardcore.model.recorder import ComponentBeat
from hardcore.recovery.budget import NS_PER_S

#: An order that was not answered within this is as good as refused.
ANSWER_NS = 10 * NS_PER_S
#: A part that was begun anew has this long to show a beat.
SETTLE_NS = 3 * NS_PER_S
#: So often a part is started anew within the restart window.
RESTARTS_MAX = 3
#: So often in one life of the core, however long that is.
RESTARTS_OF_A_LIFE_MAX = 10
#: Restarts that are remembered: those of all the parts that a page has room for.
REMEMBERED_MAX = 80


class Repair(msgspec.Struct):
    """See the module. Times are monotonic; `due_ns`: when the order that is under way has had its time.

    `beats`: the parts as they were last seen. `asked`: a person ordered it. `helpless`: parts for which nothing more is
    done in this life.
    """

    beats: tuple[ComponentBeat, ...] = ()
    name: str = ""
    due_ns: int | None = None
    asked: bool = False
    helpless: tuple[str, ...] = ()
    _told: tuple[str, ...] = ()
    _done: tuple[tuple[str, int], ...] = ()

    def order(self, name: str, now_ns: int, *, asked: bool) -> None:
        """It is ordered to start this part anew."""
        self.name, self.asked, self.due_ns = name, asked, now_ns + ANSWER_NS
        self._done = (*self._done, (name, now_ns))[-REMEMBERED_MAX:]

    def over(self) -> None:
        """The order was answered, or its time is over."""
        self.name, self.due_ns = "", None

    def give_up(self, name: str) -> None:
        """Nothing more is done about this part alone."""
        self.helpless += (name,) if name not in self.helpless else ()

    def tell(self, name: str) -> bool:
        """Return whether a person has yet to be told that nothing helps; it says so once."""
        new = name not in self._told
        self._told += (name,) if new else ()
        return new

    def settles(self, name: str, now_ns: int) -> bool:
        """Return whether it was started anew so lately that its silence says nothing yet."""
        return any(done == name and now_ns - at_ns < SETTLE_NS for done, at_ns in self._done)

    def is_spent(self, name: str, now_ns: int, window_ns: int) -> bool:
        """Return whether it was started anew as often as makes sense."""
        all_ns = [at_ns for done, at_ns in self._done if done == name]
        lately = [at_ns for at_ns in all_ns if now_ns - at_ns < max(window_ns, self._seen_within_ns(name))]
        return len(lately) >= RESTARTS_MAX or len(all_ns) >= RESTARTS_OF_A_LIFE_MAX

    def _seen_within_ns(self, name: str) -> int:
        """Return how long it takes at most to see a part stand still so often as it is begun anew, and once more."""
        limit_ns = next((part.limit_ns for part in self.beats if part.name == name), 0)
        return (RESTARTS_MAX + 1) * (2 * limit_ns + ANSWER_NS + SETTLE_NS)
