import os
import stat
from pathlib import Path

import pytest

from postmortem.dead_letters import spool
from postmortem.dead_letters.spool import Message, SpoolFailed, Unreadable


def _written(folder: Path, kind: str, **fields: object) -> Path:
    path = spool.write(folder, kind, fields)
    assert isinstance(path, Path), path
    return path


def test_what_is_written_is_read_in_the_order_of_writing(tmp_path: Path) -> None:
    paths = [_written(tmp_path / "spool", "letter", number=number) for number in range(50)]
    found = list(spool.read_all(tmp_path / "spool"))
    assert [one.path for one in found] == paths
    assert [one.fields["number"] for one in found if isinstance(one, Message)] == list(range(50))


def test_a_message_is_its_owners_alone_and_no_draft_is_left(tmp_path: Path) -> None:
    path = _written(tmp_path / "spool", "act", verb="drill")
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    assert list(path.parent.iterdir()) == [path]


def test_an_absent_spool_is_an_empty_one(tmp_path: Path) -> None:
    assert list(spool.read_all(tmp_path / "none")) == []


@pytest.mark.parametrize(
    "data",
    [b"", b"{", b"[]", b'{"version":2,"type":"letter"}', b'{"version":1}', b"[" * 200_000, b"\xff\xfe"],
)
def test_what_says_nothing_is_told_and_stops_nobody(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "00000000-0000-7000-8000-000000000000.json").write_bytes(data)
    _written(tmp_path, "letter")
    first, second = spool.read_all(tmp_path)
    assert isinstance(first, Unreadable)
    assert isinstance(second, Message)


def test_links_pipes_and_giants_are_not_read(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text('{"version":1,"type":"letter"}')
    (tmp_path / "00000000-0000-7000-8000-000000000000.json").symlink_to(tmp_path / "secret")
    os.mkfifo(tmp_path / "00000000-0000-7000-8000-000000000001.json")
    with (tmp_path / "00000000-0000-7000-8000-000000000002.json").open("wb") as file:
        file.truncate(spool.MESSAGE_BYTES_MAX + 1)
    assert [type(one) for one in spool.read_all(tmp_path)] == [Unreadable] * 3


def test_strange_names_are_passed_over(tmp_path: Path) -> None:
    (tmp_path / ".x.1.partial").write_text("{}")
    (tmp_path / "letter.json").write_text('{"version":1,"type":"letter"}')
    assert list(spool.read_all(tmp_path)) == []


def test_a_message_that_is_too_large_is_refused_with_its_size(tmp_path: Path) -> None:
    failed = spool.write(tmp_path, "letter", {"case": "x" * spool.MESSAGE_BYTES_MAX})
    assert isinstance(failed, SpoolFailed)
    assert str(spool.MESSAGE_BYTES_MAX) in failed.reason


def test_a_full_spool_refuses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spool, "MESSAGES_MAX", 2)
    for _ in range(2):
        _written(tmp_path, "letter")
    assert isinstance(spool.write(tmp_path, "letter", {}), SpoolFailed)


def test_a_spool_that_cannot_be_written_is_a_value(tmp_path: Path) -> None:
    (tmp_path / "spool").write_text("a file is in the way")
    assert isinstance(spool.write(tmp_path / "spool", "letter", {}), SpoolFailed)


def test_hostile_text_comes_back_as_it_was(tmp_path: Path) -> None:
    text = "<script>\x1b[2J\u202e\ud800"
    path = _written(tmp_path, "letter", description=text)
    message = spool.read(path)
    assert isinstance(message, Message)
    assert message.fields["description"] == text
