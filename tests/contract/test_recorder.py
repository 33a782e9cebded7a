"""The recorder page: what the core writes into it, the guard reads out of it."""

import ast
import os
import stat
import threading
from hashlib import sha256
from pathlib import Path

import pytest

from core.guarded import page as core_page
from core.guarded.recorder import FlightRecorder, LifeState, NoRecorder, Recorder, RecorderUnusable, Stage
from hardcore.host import page as host_page
from hardcore.host.recorder import PageReader, PageUnusable, make_page
from hardcore.model.recorder import (
    Census,
    CommandNote,
    ComponentBeat,
    Page,
    SlotStage,
    Threads,
    TypeCount,
    Witness,
)
from hardcore.model.recorder import LifeState as LifeStateRead

BOOT_ID = "11111111-2222-3333-4444-555555555555"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    made = tmp_path / "page"
    make_page(made, "nonce-1", BOOT_ID)
    return made


def opened(path: Path) -> Recorder:
    recorder = Recorder.open(path)
    assert isinstance(recorder, Recorder), recorder
    return recorder


def read(path: Path) -> Page:
    reader = PageReader(path, "nonce-1")
    page = reader.read()
    reader.close()
    assert isinstance(page, Page), page
    return page


def begin(recorder: FlightRecorder, n: int = 1, key: str | None = "key") -> int:
    slot = recorder.begin(
        f"command-{n}", key, "transaction", f"tx-{n}", ["assets:bank", "expenses:food"], b'{"n": 1}', n
    )
    assert slot is not None
    return slot


def test_both_sides_give_the_same_numbers_to_stages_and_states() -> None:
    assert [(s.name, s.value) for s in Stage] == [(s.name, s.value) for s in SlotStage]
    assert [(s.name, s.value) for s in LifeState] == [(s.name, s.value) for s in LifeStateRead]


def test_both_sides_mean_the_same_file() -> None:
    assert core_page.FILE_BYTES == host_page.FILE_BYTES
    assert core_page.MAGIC == host_page.MAGIC


def test_nothing_on_the_cores_side_packs_into_the_shared_page() -> None:
    sources = Path(core_page.__file__).parent.glob("*.py")
    calls = [
        node
        for source in sources
        for node in ast.walk(ast.parse(source.read_text("utf-8")))
        if isinstance(node, ast.Attribute)
    ]
    assert calls
    assert not [call for call in calls if call.attr == "pack_into"], (
        "it zeroes its target first, for readers to see"
    )


def test_a_page_is_owner_only_allocated_and_never_made_over_another(path: Path) -> None:
    status = path.stat()
    assert stat.S_IMODE(status.st_mode) == 0o600
    assert status.st_blocks * 512 >= host_page.FILE_BYTES
    before = path.read_bytes()
    with pytest.raises(FileExistsError):
        make_page(path, "nonce-2", BOOT_ID)
    assert path.read_bytes() == before


def test_a_new_page_names_its_life_and_nobody_yet(path: Path) -> None:
    reader = PageReader(path, "nonce-1")
    assert reader.identity() is None
    page = read(path)
    assert (page.nonce, page.boot_id, page.pid, page.torn) == ("nonce-1", BOOT_ID, 0, 0)
    assert not page.in_flight
    assert not page.finished
    assert not page.events
    assert page.witness is None
    assert page.last_words is None
    reader.close()


def test_the_owner_is_told_by_pid_start_and_threads(path: Path) -> None:
    recorder = opened(path)
    writer = threading.Thread(target=recorder.note_writer_thread)
    writer.start()
    writer.join()
    recorder.beat_thread(7)
    reader = PageReader(path, "nonce-1")
    start = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
    assert reader.identity() == (os.getpid(), start)
    here = threading.get_native_id()
    assert reader.threads() == Threads(loop=here, writer=writer.native_id or 0, beat=here)
    reader.close()
    recorder.close()


def test_every_beat_is_read_as_it_was_written(path: Path) -> None:
    now = iter(range(1000, 2000, 100))
    recorder = Recorder.open(path, clock=lambda: next(now))
    assert isinstance(recorder, Recorder)
    recorder.beat_loop(11)
    recorder.beat_loop(12)
    recorder.beat_thread(13)
    recorder.in_store(True)
    recorder.gc(True)
    recorder.set_epoch(7)
    recorder.set_state(LifeState.DRAINING)
    recorder.finish(begin(recorder), 201)
    recorder.answered(14)
    recorder.answered(13)
    reader = PageReader(path, "nonce-1")
    beats = reader.beats()
    assert beats is not None
    assert beats.answered_seq == 14
    assert (beats.loop_ns, beats.loop_count, beats.thread_ns, beats.thread_count) == (12, 2, 13, 1)
    assert (beats.submitted, beats.completed, beats.completed_ns) == (1, 1, 1300)
    assert (beats.in_store_since_ns, beats.gc_since_ns) == (1000, 1100)
    assert (beats.epoch, beats.state) == (7, LifeStateRead.DRAINING)
    recorder.in_store(False)
    recorder.gc(False)
    beats = reader.beats()
    assert beats is not None
    assert (beats.in_store_since_ns, beats.gc_since_ns) == (0, 0)
    assert reader.look() == (beats, None)
    reader.close()
    recorder.close()


def test_a_command_in_flight_is_read_with_all_that_is_known_of_it(path: Path) -> None:
    now = iter([100, 200, 300])
    recorder = Recorder.open(path, clock=lambda: next(now))
    assert isinstance(recorder, Recorder)
    slot = begin(recorder, 5)
    recorder.stage(slot, Stage.DECIDING)
    recorder.ordinal(slot, 42)
    note = CommandNote(
        stage=SlotStage.DECIDING,
        command_id="command-5",
        key_hash=sha256(b"key").hexdigest()[:32],
        kind="transaction",
        transaction_id="tx-5",
        account_ids=("assets:bank", "expenses:food"),
        started_ns=100,
        limit_ns=5,
        stage_ns=200,
        progress_ns=300,
        thread=threading.get_native_id(),
        ordinal=42,
        payload=b'{"n": 1}',
        payload_bytes=8,
    )
    assert read(path).in_flight == (note,)
    reader = PageReader(path, "nonce-1")
    assert reader.in_flight() == (note,)
    reader.close()
    recorder.close()


def test_the_thread_that_has_a_command_is_the_one_that_staged_it_last(path: Path) -> None:
    recorder = opened(path)
    slot = begin(recorder)
    writer = threading.Thread(target=recorder.stage, args=(slot, Stage.WRITING))
    writer.start()
    writer.join()
    (note,) = read(path).in_flight
    assert (note.stage, note.thread) == (SlotStage.WRITING, writer.native_id)
    recorder.close()


def test_progress_is_told_without_an_ordinal_and_forgotten_with_the_command(path: Path) -> None:
    now = iter(range(100, 1000, 100))
    recorder = Recorder.open(path, clock=lambda: next(now))
    assert isinstance(recorder, Recorder)
    slot = begin(recorder)
    recorder.progress(slot)
    assert [(note.ordinal, note.progress_ns) for note in read(path).in_flight] == [(0, 200)]
    recorder.finish(slot, 200)
    assert begin(recorder) == slot
    assert [note.progress_ns for note in read(path).in_flight] == [0]
    recorder.close()


def test_a_component_says_when_it_works_and_how_much_it_has_done(path: Path) -> None:
    now = iter(range(100, 1000, 100))
    recorder = Recorder.open(path, clock=lambda: next(now))
    assert isinstance(recorder, Recorder)
    importer, auditor = recorder.component("importer", 250), recorder.component("감사", 1)
    assert read(path).components == (
        ComponentBeat("importer", 0, 0, 250_000_000, 0),
        ComponentBeat("감사", 0, 0, 1_000_000, 0),
    )
    importer.works(True)
    auditor.works(True)
    importer.done(7)
    auditor.beat()
    auditor.works(False)
    assert read(path).components == (
        ComponentBeat("importer", 300, 100, 250_000_000, 7),
        ComponentBeat("감사", 500, 0, 1_000_000, 0),
    )
    recorder.close()


def test_a_component_that_is_started_anew_keeps_its_place(path: Path) -> None:
    recorder = opened(path)
    for n in range(core_page.COMPONENTS):
        recorder.component(f"part {n}", 1)
        recorder.component("part 0", 1).done()
    assert [(one.name, one.done) for one in read(path).components][:2] == [("part 0", 8), ("part 1", 0)]
    with pytest.raises(AssertionError):
        recorder.component("one more", 1)
    recorder.close()


def test_the_last_two_censuses_are_kept_the_older_first(path: Path) -> None:
    now = iter(range(100, 1000, 100))
    recorder = Recorder.open(path, clock=lambda: next(now))
    assert isinstance(recorder, Recorder)
    for n in range(3):
        recorder.census(n, 10, 5, 77, [("dict", n, 64), ("core.라" + "x" * 60, 2, 1)])
    kept = TypeCount(("core.라" + "x" * 60)[:46], 2, 1)
    assert read(path).censuses == (
        Census(200, 1, 10, 5, 77, (TypeCount("dict", 1, 64), kept)),
        Census(300, 2, 10, 5, 77, (TypeCount("dict", 2, 64), kept)),
    )
    recorder.close()
    recorder.census(9, 9, 9, 9, [])
    assert len(read(path).censuses) == 2


def test_a_census_keeps_the_first_twenty_types_and_nothing_of_a_longer_one_before(path: Path) -> None:
    recorder = opened(path)
    for many in (30, 1, 2):
        recorder.census(0, 0, 0, 0, [(f"t{n}", n, n) for n in range(many)])
    assert [len(one.types) for one in read(path).censuses] == [1, 2]
    with path.open("r+b") as file:
        file.seek(core_page.CENSUS_AT + 56)
        file.write(b"\xff" * 8)
    (torn,) = [one for one in read(path).censuses if one.torn]
    assert len(torn.types) == core_page.CENSUS_TYPES
    recorder.close()


def test_a_finished_command_leaves_its_slot_and_keeps_its_answer(path: Path) -> None:
    now = iter([100, 200])
    recorder = Recorder.open(path, clock=lambda: next(now))
    assert isinstance(recorder, Recorder)
    recorder.finish(begin(recorder, 5, key=None), 422)
    page = read(path)
    assert page.in_flight == ()
    (note,) = page.finished
    assert (note.command_id, note.key_hash, note.outcome) == ("command-5", "", 422)
    assert (note.started_ns, note.stage_ns) == (100, 200)
    assert note.account_ids == ("assets:bank", "expenses:food")
    recorder.close()


def test_a_command_is_finished_once(path: Path) -> None:
    recorder = opened(path)
    slot = begin(recorder)
    recorder.finish(slot, 200)
    with pytest.raises(AssertionError):
        recorder.finish(slot, 200)
    recorder.close()


def test_texts_are_cut_between_characters_and_account_ids_between_ids(path: Path) -> None:
    recorder = opened(path)
    ids = [f"자산:통장{n}" for n in range(30)]
    recorder.begin("가" * 20, "열쇠", "종류" * 20, "나" * 14, ids, "값".encode() * 300, 0)
    recorder.event("코드" * 20, "라" * 40)
    recorder.last_words("마" * 20, "바" * 400)
    page = read(path)
    (note,) = page.in_flight
    assert (note.command_id, note.transaction_id) == ("가" * 13, "나" * 13)
    assert note.kind == "종류" * 5
    assert note.account_ids == tuple(ids[: len(note.account_ids)])
    assert len(" ".join(ids[: len(note.account_ids) + 1]).encode()) > core_page.ACCOUNTS_BYTES_MAX
    assert (note.payload, note.payload_bytes) == (("값".encode() * 300)[:512], 900)
    assert (page.events[0].code, page.events[0].text) == (("코드" * 6)[:10], "라" * 21)
    assert page.last_words is not None
    assert (page.last_words.code, page.last_words.text) == ("마" * 13, "바" * 320)
    assert page.torn == 0
    recorder.close()


def test_an_id_too_long_for_the_field_is_cut_rather_than_lost(path: Path) -> None:
    recorder = opened(path)
    recorder.begin("c", None, "k", "t", ["a" * 300, "b"], b"", 0)
    assert read(path).in_flight[0].account_ids == ("a" * 240,)
    recorder.close()


@pytest.mark.parametrize("kept", [True, False])
def test_no_slot_no_execution(path: Path, kept: bool) -> None:
    recorder: FlightRecorder = opened(path) if kept else NoRecorder()
    slots = [begin(recorder, n) for n in range(core_page.SLOTS)]
    assert sorted(slots) == list(range(core_page.SLOTS))
    assert recorder.begin("one more", None, "k", "t", [], b"", 0) is None
    if kept:
        assert len(read(path).in_flight) == core_page.SLOTS
    recorder.finish(slots[17], 200)
    assert begin(recorder) == slots[17]
    recorder.close()


def test_the_finished_ring_keeps_the_last_ones_in_order(path: Path) -> None:
    recorder = opened(path)
    for n in range(100):
        recorder.finish(begin(recorder, n), 200 + n)
    done = read(path).finished
    assert [note.command_id for note in done] == [f"command-{n}" for n in range(36, 100)]
    assert [note.outcome for note in done] == list(range(236, 300))
    recorder.close()


def test_the_ring_of_events_keeps_the_last_ones_in_order(path: Path) -> None:
    recorder = opened(path)
    for n in range(1, 701):
        recorder.event("COUNT", str(n))
    events = read(path).events
    assert [event.index for event in events] == list(range(189, 701))
    assert all(event.text == str(event.index) for event in events)
    recorder.close()


def test_events_of_many_threads_are_all_kept(path: Path) -> None:
    recorder = opened(path)

    def tell(n: int) -> None:
        for i in range(50):
            recorder.event("T", f"{n}.{i}")

    threads = [threading.Thread(target=tell, args=(n,)) for n in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    page = read(path)
    assert {event.text for event in page.events} == {f"{n}.{i}" for n in range(8) for i in range(50)}
    assert page.torn == 0
    recorder.close()


def test_the_last_commit_is_the_witness_and_a_torn_one_leaves_the_one_before(path: Path) -> None:
    recorder = opened(path)
    for seq in (1, 2, 3):
        recorder.witness(seq, 9, sha256(bytes([seq])).digest())
    recorder.close()
    found = read(path).witness
    alone = PageReader(path)
    assert alone.witness() == found
    look = alone.look()
    assert look is not None
    assert look[1] == found
    alone.close()
    assert found is not None
    assert found == Witness(3, 9, sha256(b"\3").hexdigest(), found.at_ns)
    with path.open("r+b") as file:  # the third stands in the first place again
        file.seek(512 + 16)
        file.write(b"\xff")
    page = read(path)
    assert page.witness is not None
    assert (page.witness.seq, page.torn) == (2, 1)
    alone = PageReader(path)
    assert alone.witness() == page.witness
    alone.close()
    assert alone.witness() is None


def test_the_first_last_words_are_the_cause_and_later_ones_are_events(path: Path) -> None:
    recorder = opened(path)
    recorder.last_words("COMMIT_FAILED", "disk I/O error")
    recorder.last_words("EXCEPTION", "and then everything else")
    page = read(path)
    assert page.last_words is not None
    assert (page.last_words.code, page.last_words.text) == ("COMMIT_FAILED", "disk I/O error")
    assert [event.code for event in page.events] == ["COMMIT_FAILED", "EXCEPTION"]
    recorder.close()


def test_what_was_being_written_at_death_is_reported_and_not_dropped(path: Path) -> None:
    recorder = opened(path)
    begin(recorder)
    recorder.event("E", "text")
    recorder.close()
    with path.open("r+b") as file:
        for lock_at in (core_page.SLOTS_AT, core_page.EVENTS_AT):
            file.seek(lock_at)
            file.write(b"\x03")
    page = read(path)
    assert page.torn == 2
    assert [(note.command_id, note.torn) for note in page.in_flight] == [("command-1", True)]
    assert [(event.text, event.torn) for event in page.events] == [("text", True)]


def test_a_page_belongs_to_one_life(path: Path) -> None:
    opened(path).close()
    again = Recorder.open(path)
    assert isinstance(again, RecorderUnusable)
    assert f"belongs to process {os.getpid()}" in again.reason


@pytest.mark.parametrize("spoiled", ["missing", "short", "long", "empty", "other magic", "other version"])
def test_a_core_takes_no_page_that_is_not_one(path: Path, spoiled: str) -> None:
    content = bytearray(path.read_bytes())
    match spoiled:
        case "missing":
            path.unlink()
        case "short":
            path.write_bytes(content[:-1])
        case "long":
            path.write_bytes(content + b"\0")
        case "empty":
            path.write_bytes(b"")
        case "other magic":
            path.write_bytes(b"X" + content[1:])
        case _:
            path.write_bytes(content[:8] + b"\1" + content[9:])
    before = path.read_bytes() if path.exists() else None
    assert isinstance(Recorder.open(path), RecorderUnusable)
    assert (path.read_bytes() if path.exists() else None) == before


def test_a_page_of_another_life_is_no_evidence(path: Path) -> None:
    reader = PageReader(path, "nonce-2")
    assert reader.read() == PageUnusable("The recorder page belongs to another life.")
    assert reader.beats() is None
    assert reader.look() is None
    assert reader.in_flight() is None
    assert reader.identity() is None
    assert reader.threads() == Threads()
    assert reader.raw() == b""
    reader.close()


def test_a_closed_recorder_keeps_silent(path: Path) -> None:
    recorder = opened(path)
    recorder.close()
    recorder.event("LATE", "after the end")
    recorder.last_words("LATE", "after the end")
    recorder.close()
    assert read(path).events == ()
