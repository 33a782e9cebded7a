"""A core that can't be seen whole: why not is told with the look, and what can be seen is looked at all the more."""

import os
import resource
import struct
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from core.guarded.recorder import Recorder
from hardcore.host import clock, lives, page, processes
from hardcore.host.folders import Folders
from hardcore.host.lives import Life

#: Where a page names the core's loop, writer and beat threads (wires, section 3).
OWN_THREADS_AT = 144


@pytest.fixture
def own(tmp_path: Path) -> Iterator[tuple[Recorder, Life]]:
    """This process as the core: its page, and the guard's view of it."""
    folders = Folders(tmp_path, tmp_path)
    life = lives.conceive(folders, 1)
    life.handle = processes.find(processes.Identity(os.getpid(), processes.start_of(os.getpid()) or 0))
    recorder = Recorder.open(folders.recorder(life.nonce))
    assert isinstance(recorder, Recorder), recorder
    recorder.beat_loop(clock.now_ns())
    recorder.beat_thread(clock.now_ns())
    yield recorder, life
    recorder.close()
    life.let_go()


def _scribble(life: Life, at: int, raw: bytes) -> None:
    with life.folders.recorder(life.nonce).open("r+b") as file:
        file.seek(at)
        file.write(raw)


def test_a_whole_page_and_a_process_have_no_fault(own: tuple[Recorder, Life]) -> None:
    looked = own[1].look()
    assert looked.beats is not None
    assert looked.process is not None
    assert (looked.page_fault, looked.process_fault) == ("", "")


@pytest.mark.parametrize(
    ("at", "raw", "why"),
    [
        (0, b"X", "header was changed"),
        (256 + 8 * 10, b"\xff", "life state"),
        (page.FILE_BYTES, b"X", "the size"),
    ],
    ids=["header", "life state", "longer"],
)
def test_why_a_page_is_no_evidence_any_more_is_told_with_the_look(
    own: tuple[Recorder, Life], at: int, raw: bytes, why: str
) -> None:
    life = own[1]
    life.look()
    _scribble(life, at, raw)
    looked = life.look()
    assert looked.beats is None
    assert why in looked.page_fault


def test_a_page_that_was_cut_is_told_by_its_size(own: tuple[Recorder, Life]) -> None:
    life = own[1]
    os.truncate(life.folders.recorder(life.nonce), page.HEAD_BYTES)
    assert "the size" in life.look().page_fault
    os.truncate(life.folders.recorder(life.nonce), page.FILE_BYTES)  # the recorder still has it mapped


def test_without_beats_the_threads_are_looked_at_each_time(own: tuple[Recorder, Life]) -> None:
    life = own[1]
    _scribble(life, OWN_THREADS_AT, struct.pack("<3Q", *(threading.get_native_id(),) * 3))
    life.look()
    _scribble(life, 0, b"X")
    process = life.look().process
    assert process is not None
    assert process.loop is not None
    assert process.writer is not None


def test_why_nobody_can_look_at_the_process_is_told_with_the_look(own: tuple[Recorder, Life]) -> None:
    life = own[1]
    life.look()
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    taken: list[int] = []
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 256), hard))
        with suppress(OSError):
            taken.extend(iter(lambda: os.dup(0), -1))
        looked = life.look()
    finally:
        for fd in taken:
            os.close(fd)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    assert looked.beats is not None, "the page is kept open"
    assert looked.process is None
    assert looked.process_fault == "/proc can't be read: Too many open files."


def test_the_clocks_of_a_look_are_read_together(own: tuple[Recorder, Life]) -> None:
    life = own[1]
    for _ in range(50):
        looked = life.look()
        at_ns, others = clock.together()
        assert looked.clocks is not None
        ahead = looked.clocks.boot_ns - looked.at_ns
        assert abs(ahead - (others.boot_ns - at_ns)) < 500_000_000, "that would be called a sleep"
