"""The witness of the stacks: who waits for whom, and does the loop stand where it stood?

Stacks are looked at without stopping anybody, so each thread is read at a moment of its own. A cycle of waiting
threads that was read from one look may never have been; one that two looks agree on never ends. A thread that waits
for a named lock says so in a frame `wait_for_lock` (wires, section 4). Of locks we did not name only their addresses
may be seen: two sleeping threads that show the same two are likely to wait for each other.

The loop stands where it stood if the frames from the outside are the same, lines included, but for the last few: a
computation moves in its own frames and not in those that called it.
"""

import re
from collections import deque

import msgspec

from hardcore.model.looks import StackFrame, ThreadStack
from hardcore.model.observations import StacksSampled
from hardcore.model.verdicts import Colour, Testimony

LOOKS_MAX = 4
#: A look older than this says nothing about who waits now.
STALE_NS = 2_000_000_000
#: The innermost frames of a computation may differ, this many at most.
MOVING_FRAMES_MAX = 3
#: A lock's frame stands this near to the innermost one.
LOCK_FRAMES_MAX = 6
_LOCK_FRAME = "wait_for_lock"
_LOCK = re.compile(r"lock(?: object)? at (0x[0-9a-f]+)")


class Waiter(msgspec.Struct, frozen=True):
    """A thread that waits for a lock; `held_by` is the thread that has it."""

    tid: int
    name: str
    lock: str
    held_by: int


class Cycle(msgspec.Struct, frozen=True):
    """Threads that wait for each other in a ring. `named`: by locks with names, so it is no guess."""

    waiters: tuple[Waiter, ...]
    named: bool

    @property
    def tids(self) -> frozenset[int]:
        """The threads in it."""
        return frozenset(waiter.tid for waiter in self.waiters)

    def __str__(self) -> str:
        """Say the ring as one sentence, from its first thread back to it."""
        names = {waiter.tid: waiter.name or str(waiter.tid) for waiter in self.waiters}
        links = (f"waits for {waiter.lock} held by thread {names[waiter.held_by]}" for waiter in self.waiters)
        return f"thread {names[self.waiters[0].tid]} {', which '.join(links)}"


class StackFacts(msgspec.Struct, frozen=True):
    """`cycle`: two looks agree on it, the first of them `cycle_since_ns`. `loop_same`: whether any two looks in
    this silence found the loop in the same place; None: there are not two. `where`: the loop's place in words.
    `gil`: the thread that had the interpreter at the last look.
    """

    cycle: Cycle | None = None
    cycle_since_ns: int = 0
    loop_same: bool | None = None
    where: str = ""
    gil: str = ""


class Stacks(msgspec.Struct):
    """Remembers the last few looks."""

    _looks: deque[StacksSampled] = msgspec.field(default_factory=lambda: deque(maxlen=LOOKS_MAX))

    def hear(self, fact: StacksSampled) -> None:
        """Take in a look; one that showed nothing is none."""
        if fact.stacks:
            self._looks.append(fact)

    def find(self, loop_tid: int, silent_since_ns: int, at_ns: int) -> StackFacts:
        """Return what the looks agree on. `silent_since_ns`: the loop's last beat; its place before is the past."""
        cycle, since_ns = self._cycle(at_ns)
        places = [
            thread.frames
            for look in self._looks
            if look.at_ns > silent_since_ns
            for thread in look.stacks
            if thread.tid == loop_tid
        ]
        pairs = [_same(one, other) for n, one in enumerate(places) for other in places[n + 1 :]]
        last = self._looks[-1].stacks if self._looks else ()
        return StackFacts(
            cycle=cycle,
            cycle_since_ns=since_ns,
            loop_same=any(pairs) if pairs else None,
            where=_place(places[-1]) if places else "",
            gil=next((thread.name or str(thread.tid) for thread in last if thread.owns_gil), ""),
        )

    def _cycle(self, at_ns: int) -> tuple[Cycle | None, int]:
        if len(self._looks) < 2 or at_ns - self._looks[-1].at_ns > STALE_NS:
            return None, 0
        before, last = self._looks[-2], self._looks[-1]
        cycle = find_cycle(last.stacks)
        if cycle is None or find_cycle(before.stacks) != cycle:
            return None, 0
        return cycle, before.at_ns


def find_cycle(stacks: tuple[ThreadStack, ...]) -> Cycle | None:
    """Return a ring of waiting threads, the one with the lowest id first, or None."""
    waiters = {waiter.tid: waiter for waiter in map(_waiter, stacks) if waiter is not None}
    for tid in sorted(waiters):
        ring = [waiters[tid]]
        while ring[-1].held_by in waiters and ring[-1].held_by != tid and len(ring) <= len(waiters):
            ring.append(waiters[ring[-1].held_by])
        if ring[-1].held_by == tid and len(ring) > 1:
            return Cycle(tuple(ring), named=True)
    return _likely_cycle(stacks)


def _waiter(thread: ThreadStack) -> Waiter | None:
    for frame in thread.frames[:LOCK_FRAMES_MAX]:
        if frame.function == _LOCK_FRAME:
            names = dict(frame.names)
            held_by = names.get("held_by", "").strip("'\"")
            if not held_by.isdecimal():
                return None
            return Waiter(thread.tid, thread.name, names.get("lock_name", "").strip("'\""), int(held_by))
    return None


def _likely_cycle(stacks: tuple[ThreadStack, ...]) -> Cycle | None:
    """Return two sleeping threads that both show the same two locks, or None."""
    seen: list[tuple[ThreadStack, frozenset[str]]] = []
    for thread in stacks:
        if thread.active:
            continue
        locks = frozenset(
            match[1]
            for frame in thread.frames[:MOVING_FRAMES_MAX]
            for _, value in frame.names
            if (match := _LOCK.search(value))
        )
        for other, others in seen:
            shared = sorted(locks & others)
            if len(shared) >= 2:
                pair = sorted((other, thread), key=lambda one: one.tid)
                ring = (
                    Waiter(pair[0].tid, pair[0].name, f"one of {', '.join(shared)}", pair[1].tid),
                    Waiter(pair[1].tid, pair[1].name, f"one of {', '.join(shared)}", pair[0].tid),
                )
                return Cycle(ring, named=False)
        seen.append((thread, locks))
    return None


def _same(one: tuple[StackFrame, ...], other: tuple[StackFrame, ...]) -> bool:
    shared = 0
    for left, right in zip(reversed(one), reversed(other), strict=False):
        if (left.function, left.file) != (right.function, right.file):
            break
        shared += 1
        if left.line != right.line:
            break
    return shared > 0 and max(len(one), len(other)) - shared <= MOVING_FRAMES_MAX


def _place(frames: tuple[StackFrame, ...]) -> str:
    return f"{frames[0].function} ({frames[0].file.rpartition('/')[2]}:{frames[0].line})" if frames else ""


def testify(found: StackFacts) -> Testimony | None:
    """Return what the stacks show, or None if that is nothing."""
    if found.cycle is not None:
        guess = "" if found.cycle.named else " (likely: these locks have no names)"
        return Testimony("stacks", Colour.YELLOW, f"{found.cycle}{guess}")
    if found.loop_same is None:
        return None
    if found.loop_same:
        return Testimony(
            "stacks", Colour.YELLOW, f"two looks found the loop in the same place: {found.where}"
        )
    return Testimony("stacks", Colour.GREEN, f"each look found the loop elsewhere, last in {found.where}")
