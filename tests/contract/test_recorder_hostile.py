"""A recorder page may hold anything: reading it gives a value, never an exception."""

import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.guarded.recorder import Recorder, Stage
from hardcore.host import page as host_page
from hardcore.host.recorder import PageReader, PageUnusable, make_page
from hardcore.model.recorder import Page, SlotStage, Threads


@pytest.fixture(scope="module")
def used_page(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("page") / "page"
    make_page(path, "nonce-1", "boot")
    recorder = Recorder.open(path)
    assert isinstance(recorder, Recorder)
    for n in range(70):
        slot = recorder.begin(f"c{n}", "key", "k", "t", ["a", "b"], b"payload", 5)
        assert slot is not None
        recorder.stage(slot, Stage.DECIDING)
        if n % 2:
            recorder.finish(slot, 200)
        recorder.event("E", str(n))
        recorder.witness(n, 1, bytes(32))
    recorder.last_words("BYE", "text")
    recorder.component("importer", 100).works(True)
    for n in range(3):
        recorder.census(n, 9, 9, 9, [("dict", n, 64), ("core.X", 1, 1)])
    recorder.close()
    return path.read_bytes()


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(0, host_page.FILE_BYTES - 9), st.binary(min_size=1, max_size=8)), max_size=40
    )
)
def test_a_page_with_any_bytes_changed_is_read_or_refused(
    used_page: bytes, changes: list[tuple[int, bytes]]
) -> None:
    raw = bytearray(used_page)
    for at, new in changes:
        raw[at : at + len(new)] = new
    found = host_page.decode(bytes(raw))
    assert found is None or isinstance(found, Page)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([0, host_page.MADE_BYTES, host_page.HEAD_BYTES]))
def test_noise_behind_a_right_head_is_read_or_refused(used_page: bytes, seed: int, kept: int) -> None:
    noise = (seed.to_bytes(8, "little") * (host_page.FILE_BYTES // 8))[kept:]
    found = host_page.decode(used_page[:kept] + noise)
    assert found is None or isinstance(found, Page)
    if found is not None and seed % 2:
        assert found.torn > 0


@given(st.binary(max_size=600))
def test_a_file_of_any_bytes_is_no_page(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = tmp_path_factory.mktemp("noise") / "page"
    path.write_bytes(content)
    reader = PageReader(path)
    assert isinstance(reader.read(), PageUnusable)
    assert reader.beats() is None
    assert reader.in_flight() is None
    assert reader.identity() is None
    assert reader.threads() == Threads()
    reader.close()


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.one_of(st.integers(host_page.MADE_BYTES, 4096), st.integers(364_544, 368_600)),
            st.binary(min_size=1, max_size=64),
        ),
        max_size=20,
    )
)
def test_a_reader_of_a_page_that_was_tampered_with_gets_values_or_none(
    used_page: bytes, tmp_path_factory: pytest.TempPathFactory, changes: list[tuple[int, bytes]]
) -> None:
    raw = bytearray(used_page)
    for at, new in changes:
        raw[at : at + len(new)] = new
    path = tmp_path_factory.mktemp("tampered") / "page"
    path.write_bytes(raw[: host_page.FILE_BYTES])
    reader = PageReader(path, "nonce-1")
    look, found = reader.look(), reader.read()
    assert (look is None) == isinstance(found, PageUnusable)
    if look is not None and isinstance(found, Page):
        assert look == (found.beats, found.witness)
        assert len(found.components) <= host_page.COMPONENTS
        assert len(found.censuses) <= host_page.CENSUSES.count
        assert all(len(census.types) <= host_page.CENSUS_TYPES for census in found.censuses)
    reader.close()


@pytest.mark.parametrize("version", [0, 1, 3, 2**64 - 1])
def test_a_page_of_another_version_is_no_page(tmp_path: Path, used_page: bytes, version: int) -> None:
    path = tmp_path / "page"
    path.write_bytes(used_page[:8] + version.to_bytes(8, "little") + used_page[16:])
    reader = PageReader(path, "nonce-1")
    assert reader.read() == PageUnusable("The recorder page is not a page of this version.")
    assert reader.look() is None
    assert reader.witness() is None
    reader.close()


def test_a_stage_that_no_core_writes_counts_as_torn(used_page: bytes) -> None:
    raw = bytearray(used_page)
    raw[host_page.SLOTS.at + 64] = 99
    page = host_page.decode(bytes(raw))
    assert page is not None
    assert page.torn == 1
    (note,) = (note for note in page.in_flight if note.torn)
    assert (note.stage, note.command_id) == (SlotStage.FREE, "c0")


def test_a_fifo_or_a_link_in_the_pages_place_stops_nobody(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "link").symlink_to("/dev/zero")
    for name in ("fifo", "link", "missing"):
        reader = PageReader(tmp_path / name, "nonce-1")
        assert isinstance(reader.read(), PageUnusable)
        assert reader.beats() is None
        reader.close()


def test_a_header_changed_after_opening_ends_the_evidence(tmp_path: Path, used_page: bytes) -> None:
    path = tmp_path / "page"
    path.write_bytes(used_page)
    reader = PageReader(path, "nonce-1")
    assert reader.beats() is not None
    with path.open("r+b") as file:
        file.seek(112)
        file.write(b"nonce-2")
    assert reader.beats() is None
    assert reader.read() == PageUnusable("The recorder page's header was changed.")
    reader.close()
