"""Announcing a collection of memory, because it stops both beats of a healthy core."""

import gc
from pathlib import Path

from core.guarded.beats import note_collections
from core.guarded.recorder import Recorder
from hardcore.host.recorder import PageReader, make_page


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
