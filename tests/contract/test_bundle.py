"""The black box as the guard writes it and the investigators read it: whole or not at all, on a real disk."""

import json
import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from hardcore.snapshot import writer
from postmortem import bundle, keeping, placing
from postmortem.bundle import BundleFailed, Manifest

ID = "0199a000-0000-7000-8000-00000000000a"
FILES = {"recorder.bin": b"\0page" * 1000, "stacks.txt": "스레드 하나".encode()}


def made(parent: Path, files: dict[str, bytes] = FILES, missing: dict[str, str] | None = None) -> Path:
    path = bundle.write_bundle(parent, ID, files, missing or {})
    assert isinstance(path, Path), path
    return path


def manifest_of(path: Path) -> Manifest:
    manifest = bundle.read_manifest(path)
    assert isinstance(manifest, Manifest), manifest
    return manifest


def test_a_bundle_proves_its_own_contents(tmp_path: Path) -> None:
    path = made(tmp_path, missing={"stacks.json": "py-spy is not installed"})
    assert bundle.verify_bundle(path) == []
    assert sorted(item.name for item in path.iterdir()) == ["manifest.json", "recorder.bin", "stacks.txt"]
    raw = json.loads((path / "manifest.json").read_text())
    assert raw["complete"] is True
    assert raw["files"]["recorder.bin"]["size_bytes"] == len(FILES["recorder.bin"])
    assert len(raw["files"]["recorder.bin"]["sha256"]) == 64
    assert raw["missing"] == {"stacks.json": "py-spy is not installed"}


def test_a_bundle_is_its_owners_alone(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        path = made(tmp_path / "incidents")
    finally:
        os.umask(before)
    for folder in (path.parent, path):
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    for file in path.iterdir():
        assert stat.S_IMODE(file.stat().st_mode) == 0o600


def test_a_changed_byte_is_a_fault_and_so_is_a_stranger(tmp_path: Path) -> None:
    path = made(tmp_path)
    (path / "stacks.txt").write_bytes(b"x" * len(FILES["stacks.txt"]))
    (path / "recorder.bin").write_bytes(b"short")
    (path / "extra").touch()
    faults = " ".join(bundle.verify_bundle(path))
    assert "stacks.txt is not what its manifest says" in faults
    assert "recorder.bin has 5 bytes" in faults
    assert "'extra' is not in its manifest" in faults


def test_a_second_bundle_never_takes_the_place_of_the_first(tmp_path: Path) -> None:
    path = made(tmp_path)
    assert isinstance(bundle.write_bundle(tmp_path, ID, {"log.txt": b"other"}, {}), BundleFailed)
    assert (path / "recorder.bin").read_bytes() == FILES["recorder.bin"]


def test_what_is_too_large_is_left_out_and_named(tmp_path: Path) -> None:
    whole = b"\0" * bundle.FILE_BYTES_MAX
    names = [f"part{number}" for number in range(bundle.BUNDLE_BYTES_MAX // bundle.FILE_BYTES_MAX + 1)]
    path = made(tmp_path, {"huge": whole + b"\0", **dict.fromkeys(names, whole)})
    manifest = manifest_of(path)
    assert set(manifest.missing) == {"huge", names[-1]}
    assert bundle.verify_bundle(path) == []


def test_later_evidence_joins_the_bundle_and_its_manifest(tmp_path: Path) -> None:
    path = bundle.write_bundle(tmp_path, ID, {"recorder.bin": b"page"}, {"log.txt": "later"}, complete=False)
    assert isinstance(path, Path)
    assert bundle.verify_bundle(path) == ["its evidence was never finished"]
    assert bundle.add_files(path, {"log.txt": b"line\n"}, {"process.json": "gone"}, complete=True) is None
    assert bundle.verify_bundle(path) == []
    assert manifest_of(path).missing == {"process.json": "gone"}
    assert bundle.add_file(path, "log.txt", b"line two\n") is None
    assert bundle.verify_bundle(path) == []


def test_facts_are_kept_even_where_the_manifest_is_garbage(tmp_path: Path) -> None:
    path = made(tmp_path)
    (path / "manifest.json").write_bytes(b"\xff\x00 nothing")
    assert writer.write_facts(path, {"version": 1}) is None
    manifest = manifest_of(path)
    assert not manifest.complete
    assert "incident.json" in manifest.files
    assert "begun anew" in manifest.missing["manifest.json"]


def test_facts_make_their_folder_where_no_evidence_was_taken(tmp_path: Path) -> None:
    path = tmp_path / "incidents" / ID
    assert writer.write_facts(path, {"version": 1, "id": ID}) is None
    assert json.loads((path / "incident.json").read_text()) == {"version": 1, "id": ID}
    assert bundle.verify_bundle(path) == []


def test_two_writers_lose_nothing_of_each_other(tmp_path: Path) -> None:
    path = made(tmp_path)
    code = (
        "import sys; from pathlib import Path; from postmortem import bundle\n"
        "for n in range(20): assert bundle.add_file(Path(sys.argv[1]), f'{sys.argv[2]}{n}', b'x') is None"
    )
    children = [subprocess.Popen([sys.executable, "-c", code, str(path), name]) for name in ("a", "b")]
    try:
        assert [child.wait(50) for child in children] == [0, 0]
    finally:
        for child in children:
            child.kill()
            child.wait()
    assert bundle.verify_bundle(path) == []
    assert len(manifest_of(path).files) == 42


WRITE = """
import resource, signal, sys
from pathlib import Path
from postmortem import bundle
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
if sys.argv[2] == "die":
    signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
print(bundle.write_bundle(Path(sys.argv[1]), sys.argv[3], {"log.txt": b"x" * 100, "recorder.bin": b"x" * 9000}, {}))
"""


#: Ends itself, as a guard would that is killed, when the second file is to be synced.
CUT_SHORT = """
import os, signal, sys
from pathlib import Path
from postmortem import bundle
sync, synced = os.fsync, []
def sync_once(handle):
    if synced:
        os.kill(os.getpid(), signal.SIGKILL)
    synced.append(sync(handle))
os.fsync = sync_once
bundle.write_bundle(Path(sys.argv[1]), sys.argv[2], {"log.txt": b"x" * 100, "recorder.bin": b"x" * 9000}, {})
"""


def write_with_little_room(parent: Path, on_the_limit: str) -> "subprocess.CompletedProcess[str]":
    argv = [sys.executable, "-c", WRITE, str(parent), on_the_limit, ID]
    return subprocess.run(argv, capture_output=True, text=True, timeout=50, check=False)


def test_no_room_is_a_value_and_leaves_nothing_behind(tmp_path: Path) -> None:
    done = write_with_little_room(tmp_path, "fail")
    assert done.returncode == 0, done.stderr
    assert "BundleFailed" in done.stdout
    assert "no room on the disk" in done.stdout
    assert list(tmp_path.iterdir()) == []


def test_a_writer_that_dies_in_the_middle_leaves_a_bundle_known_as_partial(tmp_path: Path) -> None:
    done = write_with_little_room(tmp_path, "die")
    assert done.returncode == -signal.SIGXFSZ
    (found,) = bundle.find_bundles(tmp_path)
    assert found.partial
    assert found.id == ID
    assert isinstance(bundle.read_manifest(found.path), BundleFailed)
    # The next writer of the same incident begins anew and ends with a whole one.
    path = made(tmp_path)
    assert bundle.verify_bundle(path) == []
    assert [(one.id, one.partial) for one in bundle.find_bundles(tmp_path)] == [(ID, False)]


ADD = """
import resource, sys
from pathlib import Path
from postmortem import bundle
resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
print(bundle.add_file(Path(sys.argv[1]), "more", b"x"))
"""


def test_a_bundle_stays_whole_when_there_is_no_room_for_more(tmp_path: Path) -> None:
    path = made(tmp_path)
    argv = [sys.executable, "-c", ADD, str(path)]
    done = subprocess.run(argv, capture_output=True, text=True, timeout=50, check=False)
    assert "no room on the disk" in done.stdout, done.stderr
    assert bundle.verify_bundle(path) == []


@pytest.mark.parametrize("name", ["../up", ".hidden", "a/b", "", "x" * 200, "a\0b"])
def test_no_name_leads_out_of_the_bundle(tmp_path: Path, name: str) -> None:
    path = made(tmp_path)
    assert isinstance(bundle.read_file(path, name), BundleFailed)


def test_links_and_pipes_in_a_bundle_are_not_followed(tmp_path: Path) -> None:
    path = made(tmp_path)
    (tmp_path / "secret").write_text("secret")
    (path / "link").symlink_to(tmp_path / "secret")
    os.mkfifo(path / "pipe")
    (path / "folder").mkdir()
    for name in ("link", "pipe", "folder"):
        assert isinstance(bundle.read_file(path, name), BundleFailed)


@pytest.mark.parametrize(
    "raw",
    [
        b"",
        b"[]",
        b"{}",
        b'{"version": 1}',
        b'{"version": 1, "files": [], "missing": {}}',
        b'{"version": 1, "files": {"../x": {"sha256": "", "size_bytes": 1}}, "missing": {}}',
        b'{"version": 1, "files": {"a": {"sha256": 1, "size_bytes": "x"}}, "missing": {}}',
        b"[" * 100_000,
        b"\xff\xfe\x00",
    ],
)
def test_a_hostile_manifest_is_a_value(tmp_path: Path, raw: bytes) -> None:
    path = made(tmp_path)
    (path / "manifest.json").write_bytes(raw)
    assert isinstance(bundle.read_manifest(path), BundleFailed)
    assert len(bundle.verify_bundle(path)) == 1


def test_a_bundle_that_somebody_writes_is_not_taken_from_under_his_hands(tmp_path: Path) -> None:
    temporary = tmp_path / f".{ID}.partial"
    temporary.mkdir()
    (temporary / "stacks.txt").write_bytes(b"written by the other one")
    with placing.writing(temporary):  # another writer at work, on a slow disk
        refused = bundle.write_bundle(tmp_path, ID, FILES, {})
        assert isinstance(refused, BundleFailed)
        assert "another writer" in refused.reason
        assert (temporary / "stacks.txt").read_bytes() == b"written by the other one"
    assert bundle.verify_bundle(made(tmp_path)) == []


def test_facts_and_evidence_that_come_at_once_both_end_up_in_one_whole_bundle(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from hardcore.snapshot import writer\n"
        "from postmortem import bundle\n"
        "print('up', flush=True); sys.stdin.readline()\n"
        "for n in range(20):\n"
        "    path = Path(sys.argv[1]) / f'incident-{n}'\n"
        "    if sys.argv[2] == 'facts': assert writer.write_facts(path, {'n': n}) is None\n"
        "    else: bundle.write_bundle(path.parent, path.name, {'log.txt': b'x'}, {})\n"
    )
    pipe = subprocess.PIPE
    children = [
        subprocess.Popen([sys.executable, "-c", code, str(tmp_path), what], stdin=pipe, stdout=pipe)
        for what in ("facts", "evidence")
    ]
    try:
        for child in children:
            assert child.stdout is not None
            assert child.stdout.readline() == b"up\n"
        for child in children:
            assert child.stdin is not None
            child.stdin.write(b"go\n")
            child.stdin.close()
        assert [child.wait(50) for child in children] == [0, 0]
    finally:
        for child in children:
            child.kill()
            child.wait()
            assert child.stdout is not None
            child.stdout.close()
    found = bundle.find_bundles(tmp_path)
    assert [one.partial for one in found] == [False] * 20
    for one in found:
        assert bundle.verify_bundle(one.path) == []
        assert (one.path / bundle.FACTS).exists()


def test_a_writer_that_was_overtaken_leaves_no_draft_beside_the_whole_bundle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    look = bundle.is_there

    def overtaken_after_the_look(path: Path) -> bool:
        monkeypatch.undo()
        there = look(path)
        made(tmp_path)  # the other one is done, rename and all, before this one makes its draft
        return there

    monkeypatch.setattr(bundle, "is_there", overtaken_after_the_look)
    assert isinstance(bundle.write_bundle(tmp_path, ID, {"log.txt": b"late"}, {}), BundleFailed)
    assert [item.name for item in tmp_path.iterdir()] == [ID]
    assert (tmp_path / ID / "recorder.bin").read_bytes() == FILES["recorder.bin"]
    assert bundle.verify_bundle(tmp_path / ID) == []


def test_only_an_empty_draft_is_removed_beside_the_whole_bundle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    look, draft = bundle.is_there, tmp_path / f".{ID}.partial"

    def overtaken_after_the_look(path: Path) -> bool:
        monkeypatch.undo()
        there = look(path)
        made(tmp_path)
        draft.mkdir()
        (draft / "stacks.txt").write_bytes(b"of nobody knows whom")
        return there

    monkeypatch.setattr(bundle, "is_there", overtaken_after_the_look)
    assert isinstance(bundle.write_bundle(tmp_path, ID, {"log.txt": b"late"}, {}), BundleFailed)
    assert (draft / "stacks.txt").read_bytes() == b"of nobody knows whom"


def closed(parent: Path, number: int, *, facts: bool = True, size_bytes: int = 100) -> str:
    name = f"0199a000-0000-7000-8000-{number:012}"
    files = {"recorder.bin": b"x" * size_bytes, **({bundle.FACTS: b"{}"} if facts else {})}
    assert isinstance(bundle.write_bundle(parent, name, files, {}), Path)
    return name


def test_the_oldest_closed_incidents_go_and_an_open_one_never(tmp_path: Path) -> None:
    still_open = closed(tmp_path, 0, facts=False)
    names = [closed(tmp_path, number) for number in range(1, 7)]
    assert writer.prune(tmp_path, keep=names[-1]) == []
    removed = keeping.prune(tmp_path, keep=names[0], count_max=4)
    assert removed == names[1:4]
    left = [one.id for one in bundle.find_bundles(tmp_path)]
    assert left == [*reversed(names[4:]), names[0], still_open]
    assert all(item.name[0] != "." for item in tmp_path.iterdir())


def test_what_is_kept_of_incidents_has_a_maximum_of_bytes(tmp_path: Path) -> None:
    names = [closed(tmp_path, number, size_bytes=100_000) for number in range(4)]
    assert keeping.prune(tmp_path, keep=names[-1], bytes_max=250_000) == names[:2]


def test_an_incident_in_somebodys_hands_is_not_removed(tmp_path: Path) -> None:
    names = [closed(tmp_path, number) for number in range(3)]
    with placing.writing(tmp_path / names[0]):
        assert keeping.prune(tmp_path, keep=names[2], count_max=2) == [names[1]]
    assert (tmp_path / names[0] / bundle.FACTS).exists()


def test_a_removal_that_was_cut_short_is_finished_and_shown_to_nobody(tmp_path: Path) -> None:
    (tmp_path / f".{ID}.gone").mkdir()
    (tmp_path / f".{ID}.gone" / "recorder.bin").write_bytes(b"x")
    assert bundle.find_bundles(tmp_path) == []
    assert keeping.prune(tmp_path, keep="") == []
    assert list(tmp_path.iterdir()) == []


def test_a_half_written_bundle_is_completed_with_what_is_whole_in_it(tmp_path: Path) -> None:
    argv = [sys.executable, "-c", CUT_SHORT, str(tmp_path), ID]
    assert subprocess.run(argv, timeout=50, check=False).returncode == -signal.SIGKILL
    (found,) = writer.find_abandoned(tmp_path)
    path = writer.close_abandoned(found, "2026-11-21T14:08:18.500Z")
    assert isinstance(path, Path), path
    assert {*manifest_of(path).files} == {"log.txt", bundle.FACTS}
    assert bundle.verify_bundle(path) == ["its evidence was never finished"]
    assert json.loads((path / bundle.FACTS).read_text())["outcome"] == "abandoned"
    assert writer.find_abandoned(tmp_path) == ()


def image(path: Path, size_bytes: int = 5_000) -> str:
    written = path / ".core.4711"
    written.write_bytes(b"x" * size_bytes)
    name = bundle.add_image(path, written)
    assert isinstance(name, str), name
    return name


def test_a_memory_image_stands_in_the_manifest_with_its_size(tmp_path: Path) -> None:
    path = made(tmp_path)
    assert [image(path), image(path)] == ["core.1", "core.2"]
    assert manifest_of(path).images == {"core.1": 5_000, "core.2": 5_000}
    assert bundle.verify_bundle(path) == []
    (path / "core.1").write_bytes(b"x")
    (path / "core.2").unlink()
    assert bundle.verify_bundle(path) == [
        "core.1 has 1 bytes, its manifest says 5000",
        "core.2 is not readable: No such file or directory",
    ]


def test_an_incident_has_only_so_many_memory_images(tmp_path: Path) -> None:
    path = made(tmp_path)
    for _ in range(bundle.IMAGES_MAX):
        image(path)
    (path / ".core.1").write_bytes(b"x")
    assert isinstance(bundle.add_image(path, path / ".core.1"), BundleFailed)


def test_old_images_go_before_any_story_does(tmp_path: Path) -> None:
    names = [closed(tmp_path, number) for number in range(3)]
    for name in names:
        image(tmp_path / name)
    assert keeping.prune(tmp_path, keep=names[2], images_bytes_max=5_000) == []
    assert [sorted(manifest_of(tmp_path / name).images) for name in names] == [[], [], ["core.1"]]
    assert "core.1" in manifest_of(tmp_path / names[0]).missing
    assert bundle.verify_bundle(tmp_path / names[0]) == []


def test_an_image_drives_no_story_out(tmp_path: Path) -> None:
    names = [closed(tmp_path, number) for number in range(3)]
    image(tmp_path / names[2], 100_000)
    assert keeping.prune(tmp_path, keep=names[2], bytes_max=50_000) == []


def test_half_an_image_counts_with_the_images_and_drives_no_story_out(tmp_path: Path) -> None:
    names = [f"{ID}{number}" for number in range(3)]
    for name in names:
        assert isinstance(bundle.write_bundle(tmp_path, name, {bundle.FACTS: b"{}"}, {}), Path)
    half = tmp_path / names[1] / ".core.4242"
    with half.open("wb") as file:
        file.truncate(1 << 30)
    assert keeping.prune(tmp_path, keep=names[2]) == []
    assert half.exists(), "it may be one that is being written"
    assert keeping.prune(tmp_path, keep=names[2], images_bytes_max=1 << 20) == []
    assert not half.exists()
    assert bundle.verify_bundle(tmp_path / names[1]) == []


def test_what_a_dead_writer_left_half_written_is_removed_at_a_guards_beginning(tmp_path: Path) -> None:
    path = made(tmp_path)
    (path / ".core.4242").write_bytes(b"half an image")
    (path / ".observations.jsonl.4242.partial").write_bytes(b"half a recording")
    keeping.sweep(tmp_path)
    assert bundle.verify_bundle(path) == []


def test_the_next_writer_removes_the_drafts_of_one_that_died(tmp_path: Path) -> None:
    path = made(tmp_path)
    (path / ".observations.jsonl.4242.partial").write_bytes(b"half a recording")
    assert bundle.add_file(path, "log.txt", b"line\n") is None
    assert bundle.verify_bundle(path) == []


def test_a_bundle_that_is_being_written_is_not_swept(tmp_path: Path) -> None:
    path = made(tmp_path)
    draft = path / ".log.txt.4242.partial"
    draft.write_bytes(b"half a file")
    with placing.writing(path):
        keeping.sweep(tmp_path)
    assert draft.exists()
