"""Rule: threads of the core waited for each other's locks in a ring.

A thread that waits for one of the core's named locks stands in a frame `wait_for_lock` that says which lock and
which thread has it, so the ring can be read off the stacks alone and is certain. Locks of a library have no
names; two sleeping threads that both hold the same two locks in their frames are a likely ring. Without stacks
there is only what the guard had seen, and the frame that hung.
"""

import re
from collections.abc import Iterable

import msgspec
from msgspec import structs

from postmortem.analyzer.blocked import frame_finding, ids_of, plain
from postmortem.analyzer.case import Case, Confidence, Finding, Thread, Waiting
from postmortem.incident import unique

_LOCK = re.compile(r"<_thread\.(?:lock|RLock) at (0x[0-9a-f]+)>")
#: Frames from the inside out in which a library's lock may be held in a local.
_FRAMES_MAX = 6


class _Waiter(msgspec.Struct, frozen=True):
    thread: Thread
    lock: str
    held_by: str


def examine(case: Case) -> list[Finding]:
    """Name the threads and locks of the ring, and whose transactions they carried."""
    if case.incident.diagnosis != "DEADLOCK":
        return []
    if ring := _named_ring(case.threads):
        way = (
            " → ".join(f"{_name(one.thread)} → [{one.lock}]" for one in ring) + f" → {_name(ring[0].thread)}"
        )
        evidence = [
            f"thread {_name(one.thread)} waits for the lock {one.lock}, held by thread {_name(holder.thread)}"
            for one, holder in zip(ring, [*ring[1:], ring[0]], strict=True)
        ]
        waits = tuple(
            Waiting(_name(one.thread), one.lock, _name(holder.thread))
            for one, holder in zip(ring, [*ring[1:], ring[0]], strict=True)
        )
        found = _finding(Confidence.CERTAIN, way, evidence, [one.thread for one in ring])
        return [structs.replace(found, waits=waits)]
    if pair := _nameless_pair(case.threads):
        way = " ↔ ".join(_name(thread) for thread in pair)
        evidence = [f"thread {_name(thread)} sleeps with both locks in its frames" for thread in pair]
        return [_finding(Confidence.LIKELY, way, evidence, pair)]
    return frame_finding(case, "blocked")


def _named_ring(threads: Iterable[Thread]) -> list[_Waiter]:
    waiters = {str(one.thread.tid): one for one in map(_waiter, threads) if one is not None}
    for first in waiters.values():
        ring = [first]
        while (following := waiters.get(ring[-1].held_by)) is not None and len(ring) <= len(waiters):
            if following is first:
                return ring
            ring.append(following)
    return []


def _waiter(thread: Thread) -> _Waiter | None:
    frame = next((one for one in thread.frames if one.function == "wait_for_lock"), None)
    if frame is None:
        return None
    return _Waiter(thread, plain(frame.shown.get("lock_name", "")), plain(frame.shown.get("held_by", "")))


def _nameless_pair(threads: Iterable[Thread]) -> list[Thread]:
    locks = [(thread, _locks_of(thread)) for thread in threads if not thread.active]
    pairs = ((one, other) for at, one in enumerate(locks) for other in locks[at + 1 :])
    return next(([one[0], other[0]] for one, other in pairs if len(one[1] & other[1]) > 1), [])


def _locks_of(thread: Thread) -> set[str]:
    shown = (text for frame in thread.frames[:_FRAMES_MAX] for text in frame.shown.values())
    return {match[1] for text in shown if (match := _LOCK.fullmatch(text)) is not None}


def _finding(sure: Confidence, way: str, evidence: list[str], threads: Iterable[Thread]) -> Finding:
    found = [ids_of(thread.frames) for thread in threads]
    accounts = unique(one for ids in found for one in ids[0])
    transactions = unique(one for ids in found for one in ids[1])
    rule = "deadlock" if sure is Confidence.CERTAIN else "deadlock_likely"
    evidence += [f"local transaction_id = {one}" for one in transactions]
    return Finding(rule, sure, {"ring": way}, tuple(evidence), accounts, transactions)


def _name(thread: Thread) -> str:
    return thread.name or str(thread.tid or "?")
