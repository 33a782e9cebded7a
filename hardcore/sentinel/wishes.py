"""What the judge would like to know next: a look at the stacks, a look at the store's lock.

Asking is free for the core and not for the machine: a look at the stacks is a process of its own that computes
for some 20 ms. So the first is asked for at once, some more for comparison, and then no more in this suspicion; and
a machine under load, where suspicions come and go, is not asked again before the floor between two has passed.
Nothing waits for an answer: what is conclusive without it is acted on without it.
"""

import msgspec

from hardcore.model.verdicts import Wish
from hardcore.sentinel.lasting import NS_PER_MS
from hardcore.sentinel.look import Look, lasted
from hardcore.sentinel.patience import Patience

#: Pauses before each look at the stacks of one suspicion; the first is at once.
STACKS_AFTER_NS = (0, 200 * NS_PER_MS, 400 * NS_PER_MS, 400 * NS_PER_MS)
#: Between the last look of one suspicion and the first of the next.
STACKS_FLOOR_NS = 2_000 * NS_PER_MS
STORE_EVERY_NS = 500 * NS_PER_MS


class Wishes(msgspec.Struct):
    """Remembers what was asked for, and when."""

    _stacks: int = 0
    _stacks_ns: int | None = None
    _store_ns: int | None = None

    def of(self, look: Look, patience: Patience) -> frozenset[Wish]:
        """Return what this look leaves open."""
        found = set()
        if self._asks_stacks(look, patience):
            found.add(Wish.STACKS)
        if self._asks_store(look, patience):
            found.add(Wish.STORE)
        return frozenset(found)

    def _asks_stacks(self, look: Look, patience: Patience) -> bool:
        if not suspicious(look, patience):
            self._stacks = 0
            return False
        if self._stacks == len(STACKS_AFTER_NS):
            return False
        pause_ns = STACKS_AFTER_NS[self._stacks] if self._stacks else STACKS_FLOOR_NS
        if self._stacks_ns is not None and look.at_ns - self._stacks_ns < pause_ns:
            return False
        self._stacks, self._stacks_ns = self._stacks + 1, look.at_ns
        return True

    def _asks_store(self, look: Look, patience: Patience) -> bool:
        if not lasted(look.in_store_ns, patience.late_ms):
            return False
        if self._store_ns is not None and look.at_ns - self._store_ns < STORE_EVERY_NS:
            return False
        self._store_ns = look.at_ns
        return True


def suspicious(look: Look, patience: Patience) -> bool:
    """Return whether there is something that stacks would settle; a collection of memory is no riddle."""
    if look.collection.running or look.process.stopped:
        return False
    return (
        lasted(look.ages.loop_ns, patience.late_ms)
        or (look.stuck is not None and lasted(look.stuck.for_ns, patience.late_ms))
        or any(
            one.overdue or (one.in_lock and lasted(one.counted_ns, patience.late_ms)) for one in look.deciding
        )
    )
