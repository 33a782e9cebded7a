"""The recorder page while its writer lives, dies or is done something to."""

import contextlib
import os
import random
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from hashlib import sha256
from pathlib import Path
from time import monotonic

import pytest

from hardcore.host import page as host_page
from hardcore.host.recorder import PageReader, PageUnusable, make_page
from hardcore.model.recorder import Census, CommandNote, Page, SlotStage, TypeCount
from tests.contract.recorder_writer import account_ids, payload

ROOT = Path(__file__).parents[2]
WAIT_S_MAX = 30.0
READS = 150

Start = Callable[[Path], "subprocess.Popen[bytes]"]


@pytest.fixture
def start() -> Iterator[Start]:
    """Start writers; none of them outlives the test."""
    with contextlib.ExitStack() as stack:

        def started(path: Path) -> "subprocess.Popen[bytes]":
            make_page(path, "nonce-1", "boot")
            command = [sys.executable, "-m", "tests.contract.recorder_writer", str(path)]
            process = stack.enter_context(subprocess.Popen(command, cwd=ROOT, stderr=subprocess.DEVNULL))
            stack.callback(process.kill)
            return process

        yield started


def until_beats(reader: PageReader, count: int) -> None:
    deadline = monotonic() + WAIT_S_MAX
    while (beats := reader.beats()) is None or beats.loop_count < count:
        assert monotonic() < deadline, f"no {count} beats: {beats}"
        os.sched_yield()


def number(text: str) -> int:
    return int("".join(c for c in text if c.isdigit()))


def assert_one_command(note: CommandNote) -> None:
    n = number(note.command_id)
    assert note.command_id == f"c{n}"
    assert note.key_hash == sha256(f"key {n}".encode()).hexdigest()[:32]
    assert (note.kind, note.transaction_id) == (f"k{n}", f"t{n}")
    assert note.account_ids == tuple(account_ids(n))


def assert_one_census(census: Census) -> None:
    n = census.rss_bytes
    assert (census.objects, census.examined, census.took_ns) == (n + 1, n, n)
    assert census.types == tuple(TypeCount(f"type{i}.{n}", n + i, n) for i in range(1 + n % 20))


def assert_whole(page: Page) -> int:
    """Check everything that claims to be whole; return how many entries that were."""
    for note in page.in_flight:
        if not note.torn:
            assert_one_command(note)
            assert (note.limit_ns, note.payload) == (number(note.command_id), payload(note.limit_ns)[:512])
            assert note.ordinal in {0, note.limit_ns}
            assert note.stage in {SlotStage.QUEUED, 1 + note.limit_ns % 5}
    for note in page.finished:
        if not note.torn:
            assert_one_command(note)
    for event in page.events:
        assert event.torn or (event.code, event.text) == (f"e{event.index}", f"text {event.index}")
    for census in page.censuses:
        if not census.torn:
            assert_one_census(census)
    if page.witness is not None:
        seq = page.witness.seq
        assert (page.witness.epoch, page.witness.hash) == (seq + 1, sha256(str(seq).encode()).hexdigest())
    return len(page.in_flight) + len(page.finished) + len(page.events) - page.torn


def test_nothing_inconsistent_is_accepted_from_a_writer_at_full_speed(tmp_path: Path, start: Start) -> None:
    process = start(tmp_path / "page")
    reader = PageReader(tmp_path / "page", "nonce-1")
    until_beats(reader, 1000)
    accepted = rejected = beats_before = 0
    for _ in range(READS):
        page = reader.read()
        assert isinstance(page, Page)
        accepted += assert_whole(page)
        rejected += page.torn
        for note in reader.in_flight() or ():
            if not note.torn:
                assert_one_command(note)
        # Each beat is one word and only grows: half of an old one with half of a new one would jump.
        assert page.beats.loop_count >= beats_before
        assert page.beats.loop_ns <= page.beats.loop_count + 1
        look = reader.look()
        assert look is not None
        assert look[1] is not None
        assert look[1].seq >= look[0].answered_seq, "answered before it was witnessed"
        beats_before = page.beats.loop_count
    assert accepted > READS
    assert process.poll() is None
    print(f"{accepted} entries accepted, {rejected} rejected as torn")  # noqa: T201  a number to look at
    reader.close()


@pytest.mark.parametrize("seed", range(8))
def test_a_killed_writer_leaves_a_whole_page_that_ends_at_its_last_beat(
    tmp_path: Path, start: Start, seed: int
) -> None:
    process = start(tmp_path / "page")
    reader = PageReader(tmp_path / "page", "nonce-1")
    until_beats(reader, random.Random(seed).randrange(1, 5000))
    process.kill()
    process.wait()
    page = reader.read()
    assert isinstance(page, Page)
    assert_whole(page)
    # One writer, one death: at most the entry under its pen is torn.
    assert page.torn <= 1
    assert page.events[-1].index - page.beats.loop_count in {0, 1}
    assert page.witness is not None
    assert page.witness.seq - page.beats.loop_count in {0, 1}
    assert page.pid == process.pid
    reader.close()


def test_a_page_cut_under_a_living_writer_is_no_evidence_and_never_hurts_the_reader(
    tmp_path: Path, start: Start
) -> None:
    path = tmp_path / "page"
    process = start(path)
    reader = PageReader(path, "nonce-1")
    until_beats(reader, 10)
    for length in (host_page.FILE_BYTES - 1, 1000, 100, 0):
        os.truncate(path, length)
        assert reader.beats() is None
        assert reader.in_flight() is None
        assert isinstance(reader.read(), PageUnusable)
        assert len(reader.raw()) == length
    # The writer maps the page and dies of it; that is its own affair and not the reader's.
    process.wait(WAIT_S_MAX)
    assert reader.beats() is None
    reader.close()


def test_a_file_put_in_the_pages_place_changes_nothing_for_who_holds_the_page(
    tmp_path: Path, start: Start
) -> None:
    path = tmp_path / "page"
    start(path)
    reader = PageReader(path, "nonce-1")
    until_beats(reader, 10)
    make_page(tmp_path / "other", "nonce-2", "boot")
    (tmp_path / "other").replace(path)
    beats = reader.beats()
    assert beats is not None
    until_beats(reader, beats.loop_count + 1)
    late = PageReader(path, "nonce-1")
    assert isinstance(late.read(), PageUnusable)
    reader.close()
    late.close()


def test_a_page_that_grows_shrinks_and_vanishes_all_the_time_never_hurts_the_reader(tmp_path: Path) -> None:
    path = tmp_path / "page"
    make_page(path, "nonce-1", "boot")
    ending = threading.Event()

    def torment() -> None:
        while not ending.is_set():
            os.truncate(path, 700)
            os.truncate(path, host_page.FILE_BYTES)

    thread = threading.Thread(target=torment)
    thread.start()
    reader = PageReader(path, "nonce-1")
    try:
        for _ in range(READS):
            reader.beats()
            assert isinstance(reader.read(), Page | PageUnusable)
            reader.in_flight()
    finally:
        ending.set()
        thread.join()
    path.unlink()
    reader.beats()
    reader.close()
