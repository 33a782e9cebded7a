from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from uuid import UUID

import msgspec
import pytest

from core.imports.folder import ImportFolder, Imports, is_import_id
from core.imports.records import Manifest, Progress, Survey
from core.imports.states import State

SIZE = 100


def import_id(n: int) -> str:
    return str(UUID(int=n))


def kept(imports: Imports, n: int, state: State = State.DONE) -> ImportFolder:
    imports.begin(import_id(n)).file.write_bytes(b"x" * SIZE)
    made = Manifest(import_id(n), state, "bank.csv", SIZE, "00", made_ns=n)
    imports.unfinished(import_id(n)).keep_manifest(made)
    return imports.finish(import_id(n))


def left(imports: Imports) -> list[int]:
    return [one.made_ns for one in imports.newest_first()]


def test_an_import_is_there_once_it_is_whole_and_not_before(tmp_path: Path) -> None:
    imports = Imports(tmp_path)
    place = imports.begin(import_id(1))
    place.file.write_bytes(b"half")
    assert imports.open(import_id(1)).manifest() is None
    imports.clear_unfinished()
    assert not place.file.exists()
    folder = kept(imports, 1)
    assert folder.file.read_bytes() == b"x" * SIZE
    assert left(imports) == [1]


def test_what_can_not_be_cleared_away_keeps_nothing_else_from_it(tmp_path: Path) -> None:
    imports = Imports(tmp_path)
    folder = kept(imports, 1)
    stuck = folder.path / "rows-stuck.new"
    stuck.mkdir()
    (folder.path / "rows-left.new").write_bytes(b"half")
    imports.begin(import_id(2)).file.write_bytes(b"half")
    imports.clear_unfinished()
    assert sorted(path.name for path in folder.path.iterdir()) == ["file", "manifest.json", stuck.name]
    assert left(imports) == [1]
    imports.tidy(0, bytes_max=SIZE * 10, imports_max=1)
    assert left(imports) == [1]


def test_the_three_records_are_read_as_they_were_kept(tmp_path: Path) -> None:
    folder = kept(Imports(tmp_path), 1)
    assert (folder.survey(), folder.progress()) == (Survey(0), Progress())
    folder.keep_survey(Survey(3, good=2))
    folder.keep_progress(Progress(done=2), durable=False)
    assert (folder.survey(), folder.progress()) == (Survey(3, good=2), Progress(done=2))


@pytest.mark.parametrize("broken", [b"", b"{", b'{"done": "many"}', b"\xff"])
def test_a_broken_record_is_as_if_it_had_not_been_written(tmp_path: Path, broken: bytes) -> None:
    folder = kept(Imports(tmp_path), 1)
    (folder.path / "progress.json").write_bytes(broken)
    assert folder.progress() == Progress()


def test_old_previews_go_and_what_is_being_booked_stays(tmp_path: Path) -> None:
    imports = Imports(tmp_path)
    kept(imports, 1, State.PREVIEW)
    kept(imports, 2, State.COMMITTING)
    kept(imports, 3, State.DONE)
    kept(imports, 9, State.PREVIEW)
    imports.tidy(previews_before_ns=5, bytes_max=1 << 20, imports_max=10)
    assert left(imports) == [9, 3, 2]


def test_where_it_is_too_much_the_oldest_go_first_and_never_what_is_being_booked(tmp_path: Path) -> None:
    imports = Imports(tmp_path)
    kept(imports, 1, State.COMMITTING)
    for n in range(2, 6):
        kept(imports, n)
    room = 2 * imports.open(import_id(5)).bytes_kept()
    imports.tidy(previews_before_ns=0, bytes_max=room, imports_max=10)
    assert left(imports) == [5, 4, 1]
    imports.tidy(previews_before_ns=0, bytes_max=room, imports_max=1)
    assert left(imports) == [5, 1]


@pytest.mark.parametrize(
    "text", ["", "..", "../..", "a/b", import_id(1).upper()[:-1] + "G", import_id(1) + "\n"]
)
def test_no_text_of_a_client_becomes_a_path_but_an_id(text: str) -> None:
    assert not is_import_id(text)


def test_a_record_holds_no_password() -> None:
    assert not {"password", "secret"} & {field.name for field in msgspec.structs.fields(Manifest)}


def test_a_writer_that_was_left_behind_puts_nothing_in_place(tmp_path: Path) -> None:
    folder = kept(Imports(tmp_path), 1)
    folder.keep_progress(Progress(done=9), durable=False)
    folder.keep_progress(Progress(done=2), durable=False, is_wanted=lambda: False)
    assert folder.progress() == Progress(done=9)
    assert sorted(path.name for path in folder.path.iterdir()) == ["file", "manifest.json", "progress.json"]


def test_two_writers_of_a_record_never_leave_a_torn_one(tmp_path: Path) -> None:
    folder = kept(Imports(tmp_path), 1)

    def write(done: int) -> None:
        for _ in range(200):
            folder.keep_progress(Progress(done=done), durable=False)

    with ThreadPoolExecutor(2) as writers:
        working = [writers.submit(write, done) for done in (7, 1_234_567)]
        seen = {folder.progress().done for _ in range(400)}
    for one in working:
        one.result()
    assert seen <= {0, 7, 1_234_567}
    assert (folder.path / "progress.json").read_bytes() in {
        msgspec.json.encode(Progress(done=done)) for done in (7, 1_234_567)
    }
