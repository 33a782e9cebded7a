"""A household's own layouts: what is added counts, what is broken is told and stops nothing."""

import os
from pathlib import Path

import pytest

from core.imports.looking import results as rows_of
from core.imports.reading.candidates import Candidate
from core.imports.reading.formats import builtin_formats
from core.imports.reading.own_formats import FILE_BYTES_MAX, known_formats, with_own
from core.imports.reading.proposal import propose
from core.imports.records import Manifest
from core.imports.states import State
from tests.unit.core.imports.files import table
from tests.unit.core.imports.test_formats import PLAIN

FILE = "거래일,금액\n2026-03-02,-500\n"


def test_a_layout_that_was_added_is_one_of_all(tmp_path: Path) -> None:
    (tmp_path / "xx.plain.toml").write_text(PLAIN)
    known = known_formats(tmp_path)
    assert set(known.formats) == {*builtin_formats(), "xx.plain"}
    assert propose(table(FILE), known.formats).format == "xx.plain"
    assert known.broken == ()


def test_a_household_s_own_takes_the_place_of_ours(tmp_path: Path) -> None:
    own = PLAIN.replace("xx.plain", "us.chase.card")
    (tmp_path / "us.chase.card.toml").write_text(own)
    assert known_formats(tmp_path).formats["us.chase.card"].name["en"] == "Sample Bank"


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"schema = ", "Invalid value"),
        (PLAIN.replace("schema = 1", "schema = 2").encode(), "schema 2"),
        (b"\xff\xfe", "not UTF-8"),
        (b"#" * (FILE_BYTES_MAX + 1), "larger than"),
    ],
)
def test_a_broken_one_is_named_with_its_fault_and_stops_no_other(
    tmp_path: Path, data: bytes, said: str
) -> None:
    (tmp_path / "xx.plain.toml").write_text(PLAIN)
    (tmp_path / "bad.toml").write_bytes(data)
    known = known_formats(tmp_path)
    assert set(known.own) == {"xx.plain"}
    [broken] = known.broken
    assert broken.file == "bad.toml"
    assert said in broken.why


def test_a_pipe_among_the_files_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.toml")
    assert [one.file for one in known_formats(tmp_path).broken] == ["pipe.toml"]


def test_a_folder_that_is_not_there_changes_nothing(tmp_path: Path) -> None:
    assert known_formats(tmp_path / "none").formats == builtin_formats()
    assert known_formats(None).formats is builtin_formats()


def test_an_import_goes_by_the_layout_it_was_looked_at_with_whatever_becomes_of_the_file(
    tmp_path: Path,
) -> None:
    path = tmp_path / "xx.plain.toml"
    path.write_text(PLAIN)
    known, held = known_formats(tmp_path), table(FILE)
    proposal = propose(held, known.formats)
    kept = Manifest(
        *("id", State.COMMITTING, "x", 1, "00", 0),
        format="xx.plain",
        currency="KRW",
        mapping=proposal.mapping,
        own_formats=(known.own["xx.plain"],),
    )
    before = [one.identity for one in rows_of(kept, held) if isinstance(one, Candidate)]
    path.unlink()
    assert known_formats(tmp_path).own == {}
    assert [one.identity for one in rows_of(kept, held) if isinstance(one, Candidate)] == before != []
    assert "xx.plain" in with_own(kept.own_formats)


def test_the_layout_that_the_docs_show_is_one_and_reads_its_own_sample(tmp_path: Path) -> None:
    text = (Path(__file__).parents[4] / "docs" / "imports.md").read_text("utf-8")
    shown = text.partition("```toml\n")[2].partition("```")[0]
    (tmp_path / "xx.bank.account.toml").write_text(shown)
    known = known_formats(tmp_path)
    assert known.broken == ()
    layout = known.own["xx.bank.account"]
    assert propose(table(layout.test[0].input), known.formats).format == layout.id
