"""Beats: a collection of memory is announced, because it stops both; and a late loop says how late."""

import asyncio
import gc
import threading
import time
from collections.abc import Callable
from pathlib import Path

from core.guarded import page
from core.guarded.beats import LoopBeat, note_collections
from core.guarded.recorder import NoRecorder, Recorder
from hardcore.host.recorder import PageReader, make_page


class Nesting:
    """Its end asks for a collection in the middle of one, and lets other threads run meanwhile."""

    def __init__(self, look: Callable[[], bool]) -> None:
        self.itself = self
        self.look = look
        self.seen: list[bool] = []

    def __del__(self) -> None:
        gc.collect(0)
        gc.collect(2)
        asked = threading.Thread(target=gc.collect)
        asked.start()
        asked.join()
        self.seen.append(self.look())


def test_a_collection_asked_for_in_the_middle_of_one_ends_nothing(tmp_path: Path) -> None:
    make_page(tmp_path / "page", "nonce-1", "boot")
    recorder = Recorder.open(tmp_path / "page")
    assert isinstance(recorder, Recorder)
    reader = PageReader(tmp_path / "page", "nonce-1")

    def announced() -> bool:
        beats = reader.beats()
        return beats is not None and beats.gc_since_ns > 0

    seen = Nesting(announced).seen
    stop = note_collections(recorder)
    try:
        gc.collect()
    finally:
        stop()
    assert (seen, announced()) == ([True], False)
    reader.close()
    recorder.close()


def test_a_collection_is_announced_while_it_runs_and_only_then(tmp_path: Path) -> None:
    make_page(tmp_path / "page", "nonce-1", "boot")
    recorder = Recorder.open(tmp_path / "page")
    assert isinstance(recorder, Recorder)
    reader = PageReader(tmp_path / "page", "nonce-1")
    seen: list[tuple[int, str, bool]] = []

    def look(phase: str, info: dict[str, int]) -> None:
        beats = reader.beats()
        assert beats is not None
        seen.append((info["generation"], phase, beats.gc_since_ns > 0))

    stop = note_collections(recorder)
    gc.callbacks.append(look)
    try:
        gc.collect(0)
        gc.collect(2)
    finally:
        gc.callbacks.remove(look)
        stop()
    assert [s for s in seen if s[0] == 0] == [(0, "start", False), (0, "stop", False)]
    assert [s for s in seen if s[0] == 2] == [(2, "start", True), (2, "stop", False)]
    gc.collect()
    beats = reader.beats()
    assert beats is not None
    assert beats.gc_since_ns == 0
    reader.close()
    recorder.close()


def test_a_late_loop_says_how_late_and_forgets_it_slowly() -> None:
    recorder = NoRecorder()
    late_ns = 300_000_000

    async def run() -> list[int]:
        loop = asyncio.get_running_loop()
        beat = LoopBeat(loop, recorder, 1)
        beat.start()
        beat._due_ns = time.monotonic_ns() - late_ns  # as if the loop had been busy since
        seen = []
        for _ in range(3):
            beat.stop()
            beat.start()
            seen.append(recorder._words[page.LOOP_LAG_AT >> 3])
        beat.stop()
        return seen

    first, second, third = asyncio.run(run())
    assert first >= late_ns
    assert first > second > third > 0
