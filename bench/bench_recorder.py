"""What the flight recorder costs the core and its reader: medians of several rounds, with the machine.

Run `python bench/bench_recorder.py`. The page stands on /dev/shm, where the guard keeps it, if there is one.
A command is meant to cost at most 5 us. With `--heap OBJECTS` it also counts the types of a heap of so many
objects, and says for how long a thread that beats beside it was kept from running.
"""

import argparse
import gc
import os
import platform
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

from core.guarded.census import REST_S, count_types
from core.guarded.recorder import Recorder, Stage
from hardcore.host.recorder import PageReader, make_page

ROUNDS = 9
ACCOUNTS = ["assets:bank:kb", "expenses:food:market"]
PAYLOAD = b'{"date": "2026-11-21", "description": "market", "postings": []}' * 6
NONCE = "bench"
DECIDING, WRITING, COMMITTED = Stage.DECIDING, Stage.WRITING, Stage.COMMITTED
COMMAND_US_MAX = 5.0
BEAT_S = 0.005
QUIET_S = 0.15  # about as long as a census takes
TYPES = [(f"core.ledger.module_{n}.Kind", 1000 * n, 64_000 * n) for n in range(20)]


def median_us(verb: Callable[[], object], repeats: int) -> float:
    """Return the median of the rounds, in microseconds of the processor for one call of `verb`."""
    rounds = []
    for _ in range(ROUNDS):
        start_ns = time.thread_time_ns()
        for _ in range(repeats):
            verb()
        rounds.append((time.thread_time_ns() - start_ns) / repeats / 1000)
    return statistics.median(rounds)


def command(recorder: Recorder) -> None:
    """Do what a command is counted by: begin, three stages, finish."""
    slot = recorder.begin("0190b0d8-7c3a-7000", "a key", "transaction", "0190b0d8", ACCOUNTS, PAYLOAD, 1)
    assert slot is not None
    recorder.stage(slot, DECIDING)
    recorder.stage(slot, WRITING)
    recorder.stage(slot, COMMITTED)
    recorder.finish(slot, 201)


def measure(recorder: Recorder, reader: PageReader) -> None:
    """Print a line for each verb of the writer and of the reader."""
    slot = recorder.begin("one", None, "transaction", "t", ACCOUNTS, PAYLOAD, 1)
    assert slot is not None
    lines: list[tuple[str, Callable[[], object], int]] = [
        ("writer: stage", lambda: recorder.stage(slot, DECIDING), 20_000),
        ("writer: loop beat", lambda: recorder.beat_loop(time.monotonic_ns()), 20_000),
        ("writer: witness", lambda: recorder.witness(1, 1, bytes(32)), 5000),
        ("writer: claim of an answer", lambda: recorder.answered(time.monotonic_ns()), 20_000),
        ("writer: progress", lambda: recorder.ordinal(slot, 1), 20_000),
        ("writer: beat of a component", recorder.component("bench", 1000).beat, 20_000),
        ("writer: census of 20 types", lambda: recorder.census(1, 1, 1, 1, TYPES), 500),
        ("writer: event", lambda: recorder.event("CODE", "a line of text"), 5000),
        ("reader: beats", reader.beats, 5000),
        ("reader: beats and witness", reader.look, 5000),
        ("reader: commands in flight (1)", reader.in_flight, 300),
        ("reader: the whole page, rings full", reader.read, 20),
    ]
    whole_us = median_us(lambda: command(recorder), 2000)
    kept = "kept" if whole_us <= COMMAND_US_MAX else "missed"
    print(
        f"{'writer: begin + 3 stages + finish':<40}{whole_us:>10.2f} us   (at most {COMMAND_US_MAX:.0f}: {kept})"
    )
    for name, verb, repeats in lines:
        print(f"{name:<40}{median_us(verb, repeats):>10.2f} us")


class Beating:
    """A thread that beats, and remembers the longest time between two beats."""

    def __init__(self) -> None:
        """Beat until `stop`."""
        self.longest_ns = 0
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        last_ns = time.monotonic_ns()
        while not self._ending.wait(BEAT_S):
            now_ns = time.monotonic_ns()
            self.longest_ns = max(self.longest_ns, now_ns - last_ns)
            last_ns = now_ns

    def stop(self) -> None:
        """Beat no more."""
        self._ending.set()
        self._thread.join()


def longest_ms(work: Callable[[], object]) -> float:
    """Return the longest time that a thread beside `work` was kept from beating, in milliseconds."""
    beating = Beating()
    work()
    beating.stop()
    return beating.longest_ns / 1e6


def measure_census(objects: int) -> None:
    """Print what a count of so many objects (lists, tuples, some of a class) costs, and how long it holds others up."""
    gc.freeze()
    # Nothing may be collected meanwhile, or the collection would be what is measured.
    gc.disable()
    heap: list[object] = [([n], (n, [n]), Recorded(n)) for n in range(objects // 5)]
    counted = [count_types(1 << 40) for _ in range(ROUNDS)]
    listing_ms = statistics.median(one.listing_ns / 1e6 for one in counted)
    beside = [longest_ms(lambda: count_types(1 << 40, lambda: time.sleep(REST_S))) for _ in range(ROUNDS)]
    alone = [longest_ms(lambda: time.sleep(QUIET_S)) for _ in range(ROUNDS)]
    print(f"census of {counted[0].objects} objects, {counted[0].examined} of them looked at:")
    print(f"{'  the listing, of the processor':<40}{listing_ms:>10.2f} ms")
    print(f"{'  longest time without a beat (of 5 ms)':<40}{statistics.median(beside):>10.2f} ms")
    print(f"{'  the same without a census':<40}{statistics.median(alone):>10.2f} ms")
    del heap


class Recorded:
    """An object with a number, as programs have them by the million."""

    def __init__(self, n: int) -> None:
        """Keep the number."""
        self.n = n


def main() -> None:
    """Make a page, measure on it, remove it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--heap", type=int, default=0, metavar="OBJECTS", help="also count a heap of so many")
    asked = parser.parse_args()
    load = os.getloadavg()[0]
    print(f"{platform.machine()}, {os.cpu_count()} processors, load {load:.1f}, Linux {platform.release()},")
    print(f"Python {sys.version.split()[0]}; medians of {ROUNDS} rounds")
    shm = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=shm if shm.is_dir() else None) as folder:
        path = Path(folder) / "page"
        make_page(path, NONCE, "boot")
        recorder, reader = Recorder.open(path), PageReader(path, NONCE)
        assert isinstance(recorder, Recorder)
        try:
            measure(recorder, reader)
        finally:
            reader.close()
            recorder.close()
    if asked.heap:
        measure_census(asked.heap)


if __name__ == "__main__":
    main()
