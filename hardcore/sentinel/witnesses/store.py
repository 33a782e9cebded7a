"""The witness of the store: what the core says of it, and who else holds its write lock.

The core's own word (full, read-only, well again) stands until it says otherwise, or has committed since: a word can
be lost on its way. A holder is read from the kernel's
table of locks, from outside: the same stranger must be found in two looks, because a backup that passes through
holds the lock for a moment and is no outage.
"""

import msgspec

from hardcore.model.looks import LockHolder
from hardcore.model.observations import StoreFault, StoreLooked, StoreTold
from hardcore.model.recorder import Witness
from hardcore.model.verdicts import Colour, Testimony
from hardcore.sentinel.lasting import NS_PER_MS
from hardcore.sentinel.seen_time import SeenTime

#: A look older than this says nothing about now.
STALE_NS = 3_000_000_000


class StoreFindings(msgspec.Struct, frozen=True):
    """What is wrong with the store: `told` by the core since `told_ns`; `holder`: a stranger with the write lock.

    `held_since_ns` is when the same one was first seen, `held_ns` how long that is as far as we were there, `looks`
    in how many looks in a row.
    """

    told: StoreFault = StoreFault.OK
    told_ns: int = 0
    holder: LockHolder | None = None
    held_since_ns: int = 0
    held_ns: int = 0
    looks: int = 0


class Store(msgspec.Struct):
    """Remembers the core's word and the looks at the lock."""

    _told: StoreFault = StoreFault.OK
    _told_ns: int = 0
    _holder: LockHolder | None = None
    _held_since_ns: int = 0
    _looked_ns: int = 0
    _looks: int = 0

    def hear(self, fact: StoreTold | StoreLooked) -> None:
        """Take in a word of the core's, or a look at the lock."""
        if isinstance(fact, StoreTold):
            self._told_ns = self._told_ns if fact.fault is self._told else fact.at_ns
            self._told = fact.fault
            return
        stranger = next((holder for holder in fact.holders if not holder.ours), None)
        if stranger is None or self._holder is None or stranger.pid != self._holder.pid:
            self._held_since_ns, self._looks = fact.at_ns, 0
        self._holder, self._looked_ns = stranger, fact.at_ns
        self._looks += 1

    def find(self, witness: Witness | None, seen: SeenTime) -> StoreFindings:
        """Return what is known at this look; `witness` is the last commit."""
        if witness is not None and witness.at_ns > self._told_ns:
            self._told = StoreFault.OK
        known = self._holder is not None and seen.at_ns - self._looked_ns <= STALE_NS
        return StoreFindings(
            told=self._told,
            told_ns=self._told_ns,
            holder=self._holder if known else None,
            held_since_ns=self._held_since_ns if known else 0,
            held_ns=seen.since(self._held_since_ns) if known else 0,
            looks=self._looks if known else 0,
        )


def who(holder: LockHolder) -> str:
    """Return a holder in words."""
    return (
        f"process {holder.pid} ({holder.name})" if holder.pid else "a process that can't be named from here"
    )


def testify(found: StoreFindings) -> Testimony | None:
    """Return what the store's state is, or None if nobody complains. A lock held by a stranger is only said."""
    if found.told is not StoreFault.OK:
        words = "is full" if found.told is StoreFault.FULL else "takes no writes"
        return Testimony("store", Colour.YELLOW, f"the core says that its store {words}")
    if found.holder is not None and found.looks >= 2:
        why = f"{who(found.holder)} has held the store's write lock for {found.held_ns // NS_PER_MS} ms"
        return Testimony("store", Colour.YELLOW, why)
    return None
