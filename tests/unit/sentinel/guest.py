"""A guest that beats like a core and then does one thing wrong, or one that only looks wrong.

`python -m tests.unit.sentinel.guest PAGE FAULT`. It ends when its standard input does.
"""

import asyncio
import ctypes
import gc
import json
import re
import sys
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path

from core.guarded.beats import BEAT_MS, LoopBeat, ThreadBeat, note_collections
from core.guarded.locks import NamedLock
from core.guarded.recorder import LifeState, Recorder, Stage

WRONG_AFTER_S = 0.6
HANG_S = 4
_MS = 1_000_000
_LIMIT_NS = 1_000 * _MS


def _spin() -> None:
    turns = 0
    while True:
        turns += 1


def _sleep_with_interpreter() -> None:
    ctypes.PyDLL(None).sleep(HANG_S)


def _lock_with_interpreter() -> None:
    mutex = ctypes.create_string_buffer(64)
    libc = ctypes.PyDLL(None)
    libc.pthread_mutex_lock(mutex)
    libc.pthread_mutex_lock(mutex)


def _match_for_ever() -> None:
    re.match(r"(a+)+$", "a" * 40 + "b")


def _dump_much() -> None:
    json.dumps([{"n": n, "text": str(n)} for n in range(200_000)], indent=1)


def _collect_much(heap: list[object]) -> None:
    del heap
    gc.collect()


def _on_writer(recorder: Recorder, slot: int, run: Callable[[], object]) -> None:
    recorder.note_writer_thread()
    recorder.stage(slot, Stage.DECIDING)
    run()


def _embrace(recorder: Recorder, slot: int) -> None:
    ours, theirs = NamedLock("ours"), NamedLock("theirs")
    theirs_is_taken, ours_is_taken = threading.Event(), threading.Event()

    def other() -> None:
        with theirs:
            theirs_is_taken.set()
            ours_is_taken.wait()
            with ours:
                pass

    def decide() -> None:
        with ours:
            ours_is_taken.set()
            theirs_is_taken.wait()
            with theirs:
                pass

    threading.Thread(target=other, daemon=True, name="other").start()
    _on_writer(recorder, slot, decide)


def _begin(recorder: Recorder, run: Callable[[int], object]) -> None:
    slot = recorder.begin("c1", "k1", "transaction", "t1", ["assets:1"], b"", _LIMIT_NS)
    assert slot is not None
    threading.Thread(target=run, args=(slot,), daemon=True, name="writer").start()


async def _live(recorder: Recorder, fault: str) -> None:
    loop = asyncio.get_running_loop()
    gc.disable()  # the one collection shall be ours
    # Some three million objects that a full collection has to look at, one by one.
    heap: list[object] = [{"n": [[n]]} for n in range(1_000_000)] if "collection" in fault else []
    note_collections(recorder)
    LoopBeat(loop, recorder, BEAT_MS).start()
    ThreadBeat(recorder, BEAT_MS).start()
    recorder.set_state(LifeState.READY)
    hang = threading.Event().wait
    faults: dict[str, Callable[[], object]] = {
        "block": partial(ctypes.CDLL(None).sleep, HANG_S),
        "spin": _spin,
        "gil_asleep": _sleep_with_interpreter,
        "gil_locked": _lock_with_interpreter,
        "gil_computing": _match_for_ever,
        "dump": _dump_much,
        "collection": partial(_collect_much, heap),
        "neighbours_collection": partial(_collect_much, heap),
        "neighbours_dump": _dump_much,
        "slow_transaction": lambda: _begin(recorder, lambda slot: _on_writer(recorder, slot, hang)),
        "deadlock": lambda: _begin(recorder, partial(_embrace, recorder)),
    }
    if fault in faults:
        loop.call_later(WRONG_AFTER_S, faults[fault])
    await asyncio.to_thread(sys.stdin.readline)


def main(page: Path, fault: str) -> None:
    recorder = Recorder.open(page)
    assert isinstance(recorder, Recorder), recorder
    asyncio.run(_live(recorder, fault))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
