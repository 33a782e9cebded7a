"""What the flight recorder costs the core and its reader: medians of several rounds, with the machine.

Run `python bench/bench_recorder.py`. The page stands on /dev/shm, where the guard keeps it, if there is one.
"""

import os
import platform
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from core.guarded.recorder import Recorder, Stage
from hardcore.host.recorder import PageReader, make_page

ROUNDS = 9
ACCOUNTS = ["assets:bank:kb", "expenses:food:market"]
PAYLOAD = b'{"date": "2026-11-21", "description": "market", "postings": []}' * 6
NONCE = "bench"


def median_us(verb: Callable[[], object], repeats: int) -> float:
    """Return the median of the rounds, in microseconds for one call of `verb`."""
    rounds = []
    for _ in range(ROUNDS):
        start_ns = time.perf_counter_ns()
        for _ in range(repeats):
            verb()
        rounds.append((time.perf_counter_ns() - start_ns) / repeats / 1000)
    return statistics.median(rounds)


def command(recorder: Recorder) -> None:
    """Do what one transaction does: begin, four stages, finish."""
    slot = recorder.begin("0190b0d8-7c3a-7000", "a key", "transaction", "0190b0d8", ACCOUNTS, PAYLOAD, 1)
    assert slot is not None
    recorder.stage(slot, Stage.DECIDING)
    recorder.stage(slot, Stage.WRITING)
    recorder.stage(slot, Stage.COMMITTED)
    recorder.stage(slot, Stage.ANSWERING)
    recorder.finish(slot, 201)


def measure(recorder: Recorder, reader: PageReader) -> None:
    """Print a line for each verb of the writer and of the reader."""
    slot = recorder.begin("one", None, "transaction", "t", ACCOUNTS, PAYLOAD, 1)
    assert slot is not None
    lines: list[tuple[str, Callable[[], object], int]] = [
        ("writer: begin + 4 stages + finish", lambda: command(recorder), 2000),
        ("writer: stage", lambda: recorder.stage(slot, Stage.DECIDING), 20_000),
        ("writer: loop beat", lambda: recorder.beat_loop(time.monotonic_ns()), 20_000),
        ("writer: witness", lambda: recorder.witness(1, 1, bytes(32)), 5000),
        ("writer: event", lambda: recorder.event("CODE", "a line of text"), 5000),
        ("reader: beats", reader.beats, 5000),
        ("reader: commands in flight (1)", reader.in_flight, 300),
        ("reader: the whole page, rings full", reader.read, 20),
    ]
    for name, verb, repeats in lines:
        print(f"{name:<40}{median_us(verb, repeats):>10.2f} us")


def main() -> None:
    """Make a page, measure on it, remove it."""
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


if __name__ == "__main__":
    main()
