"""Announcing a collection of memory, because it stops both beats of a healthy core."""

import gc
import threading
from collections.abc import Callable
from pathlib import Path

from core.guarded.beats import note_collections
from core.guarded.recorder import Recorder
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
