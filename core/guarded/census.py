"""The census: which types fill this process's memory, written down while it lives because nobody can ask later.

A thread lists what the collector tracks, looks at an even sample of it and leaves the largest types on the
recorder page: once a minute, and more often when memory runs short. What it must never do is hold up the core:
the listing is one call that keeps the interpreter for about 20 ns an object, so it is only made while that is
expected to be short; the counting goes in slices with rests. To learn about an object no code of its class is
run: a type's name, size and number of items are read through `type` and the built-in bases. But whatever dies
while the sample holds it is finalised on this thread, as garbage in cycles is on whichever thread the collector
runs: so the sample is measured at once, without a rest, and dropped after 10 to 30 ms. What was frozen after
loading is not listed, so the census shows what has grown since; strings, numbers and bytes are never listed, so
a leak of them shows as the containers that hold them; the attributes of an object count only where they have a
dict of their own. Above one to three million objects the listing is too long for every minute and is made only
where memory runs short; the page then keeps the last ones, and an event says so. Not chosen: a fork that counts
in peace, which copies the page tables of the very process that is short of memory and is a child that a guard
wonders about; tracemalloc, which makes every allocation dearer.
"""

import gc
import os
import sys
import threading
import time
from array import array
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import msgspec

from core.guarded import page
from core.guarded.recorder import FlightRecorder

#: How often a census is taken.
CENSUS_MS: Final = 60_000
#: How often the resident memory is looked at.
LOOK_MS: Final = 1_000
#: From this share of the limit on, a census is due sooner than usual.
PRESSED_PERCENT: Final = 80
PRESSED_EVERY_MS: Final = 10_000
#: How long one listing may keep the interpreter: usually (a beat's length, since letting the list go takes
#: some time too), and where memory runs short and it may be the last.
LISTING_MS_MAX: Final = 25
PRESSED_LISTING_MS_MAX: Final = 150
#: No more than this part of the time goes into listings: one that took 100 ms is followed by 20 s without.
LISTING_PART: Final = 200
#: Until one was measured. A block of memory is less than an object that is listed, in most programs by far.
LISTING_NS_PER_BLOCK: Final = 6.0

SAMPLE_MAX: Final = 50_000
SLICE: Final = 2_000
REST_S: Final = 0.002
#: What is larger is counted as it is and not scaled: ten such in a sample are not ten thousand.
LARGE_BYTES: Final = 1 << 20
COLLECTOR_BYTES: Final = 16  # what the collector keeps before each object

_module_of: Final = type.__dict__["__module__"].__get__
_name_of: Final = type.__dict__["__qualname__"].__get__
_GROWING: Final = (dict, list, set, frozenset, deque)


class _Tally(msgspec.Struct):
    """One type of the sample. `size_bytes` is of those that are not large."""

    kind: type
    count: int = 0
    size_bytes: int = 0
    large_bytes: int = 0


class Counted(msgspec.Struct, frozen=True):
    """What a listing came to: `types` are name, count and bytes, the largest first, as many as the page takes."""

    objects: int
    examined: int
    listing_ns: int
    types: tuple[tuple[str, int, int], ...]


def count_types(rss_bytes: int, rest: Callable[[], object] = lambda: None) -> Counted:
    """Count by type what the collector tracks, `rest`-ing between slices; nothing is larger than `rss_bytes`."""
    started_ns = time.thread_time_ns()
    listed = gc.get_objects()
    listing_ns = time.thread_time_ns() - started_ns
    objects = len(listed)
    # The whole list goes at once: as long as it stands, nothing in the process can be freed.
    sample = listed[:: stride(objects)]
    listed.clear()
    del listed
    examined = len(sample)
    kinds, sizes = _measure(sample)
    # The sample goes before the first rest: what it holds might be finalised on this thread.
    sample.clear()
    tallies: dict[int, _Tally] = {}
    for start in range(0, examined, SLICE):
        part = slice(start, start + SLICE)
        _tell_apart(kinds[part], sizes[part], tallies, rss_bytes)
        rest()
    scaled = [
        (name(tally.kind), tally.count * objects // examined, _bytes_of(tally, objects, examined))
        for tally in tallies.values()
    ]
    scaled.sort(key=lambda one: one[2], reverse=True)
    return Counted(objects, examined, listing_ns, tuple(scaled[: page.CENSUS_TYPES]))


def _measure(sample: list[Any]) -> tuple[list[type], "array[int]"]:
    """Return type and own bytes of each object."""
    kinds = list(map(type, sample))
    # By its address: a metaclass may have its own idea of hash and equality.
    measures = {at: measure_of(kind) for at, kind in {id(kind): kind for kind in kinds}.items()}
    return kinds, array("q", [measures[id(kind)](one) for kind, one in zip(kinds, sample, strict=True)])


def _tell_apart(kinds: list[type], sizes: "array[int]", tallies: dict[int, _Tally], bytes_max: int) -> None:
    for kind, measured_bytes in zip(kinds, sizes, strict=True):
        tally = tallies.get(id(kind))
        if tally is None:
            tally = tallies[id(kind)] = _Tally(kind)
        # Some types' number of items is none; then nothing is sure but that it fits into the process.
        size_bytes = min(max(measured_bytes, 0) + COLLECTOR_BYTES, bytes_max)
        tally.count += 1
        if size_bytes < LARGE_BYTES:
            tally.size_bytes += size_bytes
        else:
            tally.large_bytes += size_bytes


def _bytes_of(tally: _Tally, objects: int, examined: int) -> int:
    return tally.size_bytes * objects // examined + tally.large_bytes


def measure_of(kind: type) -> Callable[[Any], int]:
    """Return what tells the own bytes of a `kind` by built-in code alone: a class may have its own `__sizeof__`.

    What a subclass adds to a built-in container is its fixed part alone, which is in this size too.
    """
    return next((base.__sizeof__ for base in _GROWING if issubclass(kind, base)), object.__sizeof__)


def name(kind: type) -> str:
    """Return module and name of a type, as much of its end as the page has room for."""
    try:
        module, own = _module_of(kind), _name_of(kind)
    except AttributeError:  # made where nothing has a name
        module, own = "", _name_of(kind)
    whole = own if type(module) is not str or module in {"", "builtins"} else f"{module}.{own}"
    while len(whole.encode("utf-8", "replace")) > page.TYPE_NAME_BYTES_MAX and "." in whole:
        whole = whole.partition(".")[2]
    return whole


def stride(objects: int) -> int:
    """Return how many steps lie between two objects of the sample: 1, or a prime.

    What is made together lies together (a row, its dict, its list, the next row): a stride that shares a factor
    with the length of such a pattern would see some types always and others never.
    """
    least = -(-objects // SAMPLE_MAX)
    if least < 2:
        return 1
    return next(n for n in range(least, 2 * least + 2) if all(n % f for f in range(2, int(n**0.5) + 1)))


class Pace(msgspec.Struct):
    """When a census is due, and whether it can be had without holding up the core. Times: monotonic ns."""

    every_ms: int
    memory_bytes: int | None
    last_ns: int
    listing_ns: int = 0
    ns_per_block: float = LISTING_NS_PER_BLOCK

    def is_pressed(self, rss_bytes: int) -> bool:
        """Say whether memory runs short. Without a limit it never does."""
        return self.memory_bytes is not None and rss_bytes * 100 > self.memory_bytes * PRESSED_PERCENT

    def is_due(self, now_ns: int, rss_bytes: int) -> bool:
        """Say whether enough time has gone by since the last one was due."""
        every_ms = min(self.every_ms, PRESSED_EVERY_MS) if self.is_pressed(rss_bytes) else self.every_ms
        return now_ns - self.last_ns >= max(every_ms * 1_000_000, self.listing_ns * LISTING_PART)

    def is_short(self, rss_bytes: int, blocks: int) -> bool:
        """Say whether a listing of a heap of so many blocks is expected to be over soon enough."""
        most_ms = PRESSED_LISTING_MS_MAX if self.is_pressed(rss_bytes) else LISTING_MS_MAX
        return self.expected_ns(blocks) <= most_ms * 1_000_000

    def expected_ns(self, blocks: int) -> int:
        """Return how long a listing is expected to keep the interpreter, as the last one did."""
        return int(blocks * self.ns_per_block)

    def learn(self, listing_ns: int, blocks: int) -> None:
        """Remember what a listing took: time of the processor, which no busy neighbour makes longer."""
        self.listing_ns = listing_ns
        self.ns_per_block = listing_ns / max(1, blocks)


class CensusTaker:
    """The thread that counts."""

    def __init__(self, recorder: FlightRecorder, every_ms: int, memory_bytes: int | None) -> None:
        """Take a census each `every_ms` after `start`, and sooner near `memory_bytes` (None: no limit is known)."""
        self._recorder = recorder
        self._pace = Pace(every_ms, memory_bytes, 0)
        self._look_s = min(LOOK_MS, every_ms) / 1000
        self._passed_over = False
        self._ending = threading.Event()
        # A daemon: a process that leaves by an exception shall not wait to be counted.
        self._thread = threading.Thread(target=self._run, name="census", daemon=True)

    def start(self) -> None:
        """Count from now on."""
        self._pace.last_ns = time.monotonic_ns()
        self._thread.start()

    def stop(self) -> None:
        """Count no more; returns when the thread has ended, which is soon."""
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        page_bytes = os.sysconf("SC_PAGE_SIZE")
        with Path("/proc/self/statm").open("rb", buffering=0) as statm:
            while not self._ending.wait(self._look_s):
                rss_bytes = int(os.pread(statm.fileno(), 256, 0).split()[1]) * page_bytes
                now_ns = time.monotonic_ns()
                if self._pace.is_due(now_ns, rss_bytes):
                    self._pace.last_ns = now_ns
                    self._take(rss_bytes, now_ns)

    def _take(self, rss_bytes: int, now_ns: int) -> None:
        blocks = sys.getallocatedblocks()
        if not self._pace.is_short(rss_bytes, blocks):
            self._pass_over(f"{blocks} blocks, {self._pace.expected_ns(blocks) // 1_000_000} ms to list")
            return
        try:
            counted = count_types(rss_bytes, lambda: self._ending.wait(REST_S))
        except MemoryError:
            self._pass_over("no memory for the list")
            return
        self._passed_over = False
        self._pace.learn(counted.listing_ns, blocks)
        took_ns = time.monotonic_ns() - now_ns
        self._recorder.census(rss_bytes, counted.objects, counted.examined, took_ns, counted.types)

    def _pass_over(self, why: str) -> None:
        """Say once why there are no more censuses: the last ones stay on the page, with their time."""
        if not self._passed_over:
            self._passed_over = True
            self._recorder.event("CENSUS_PASSED_OVER", why)
