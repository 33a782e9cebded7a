"""The guard's log: a disk that takes nothing costs lines, never the time of whoever writes them."""

import json
import os
from pathlib import Path

import pytest

from hardcore.host import logs
from hardcore.host.logs import LogFile, LogThread, cut, place
from hardcore.host.said import LogEnd
from tests.waiting import until


def lines(path: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def test_lines_stand_in_the_order_in_which_they_were_told(tmp_path: Path) -> None:
    log = LogThread(LogFile(tmp_path / "log"))
    for number in range(500):
        log.add({"n": number})
    assert log.close(10)
    assert [line["n"] for line in lines(tmp_path / "log")] == list(range(500))


def test_a_line_that_can_not_be_put_down_costs_no_other(tmp_path: Path) -> None:
    log = LogThread(LogFile(tmp_path / "log"))
    around: list[object] = []
    around.append(around)
    log.add({"n": around})
    log.add({"n": 1})
    assert log.close(10)
    assert lines(tmp_path / "log") == [{"n": 1}]


def test_a_disk_that_hangs_holds_nobody_up_and_what_was_dropped_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(logs, "WAITING_MAX", 10)
    path = tmp_path / "log"
    os.mkfifo(path)  # opening it hangs until somebody reads
    log = LogThread(LogFile(path))
    for number in range(100):
        log.add({"n": number})
    assert not log.close(0), "what hangs is not waited for"
    fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    text = b""
    try:

        def all_told() -> bool:
            nonlocal text
            try:
                text += os.read(fd, 1 << 16)
            except BlockingIOError:
                return False
            return b"dropped" in text and text.endswith(b"\n")

        until(all_told, "the log to tell what it dropped")
    finally:
        os.close(fd)
    told = [json.loads(line) for line in text.splitlines()]
    kept = [line["n"] for line in told if "n" in line]
    assert kept == list(range(len(kept)))
    (dropped,) = (line["lines"] for line in told if line.get("kind") == "dropped")
    assert len(kept) + int(str(dropped)) == 100


def test_the_guards_own_words_go_beside_the_sockets_where_their_folder_takes_none(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    log = LogFile(tmp_path / "gone" / "sentinel.log", tmp_path / "run")
    log.append({"kind": "phase"})
    assert json.loads((tmp_path / "run" / "sentinel.log").read_text()) == {"kind": "phase"}


def test_nobody_is_started_with_another_log_where_the_folder_of_his_is_gone(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    with pytest.raises(FileNotFoundError):
        place(tmp_path / "gone" / "core.log", tmp_path / "run")
    assert place(tmp_path / "core.log", tmp_path / "run") == tmp_path / "core.log"


def test_a_log_that_others_write_is_bounded_while_they_run_and_loses_no_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(logs, "LOG_BYTES_MAX", 100)
    monkeypatch.setattr(logs, "CUT_EVERY_S", 0.01)
    path = tmp_path / "core.log"
    writer = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    log = LogThread(LogFile(tmp_path / "sentinel.log"), (path,))
    try:
        os.write(writer, b"a" * 99 + b"\n")
        until(lambda: path.stat().st_size == 0, "the log to be cut")
        os.write(writer, b"b\n")
    finally:
        os.close(writer)
    assert log.close(10)
    assert (path.read_bytes(), (tmp_path / "core.log.1").read_bytes()) == (b"b\n", b"a" * 99 + b"\n")
    assert sorted(one.name for one in tmp_path.iterdir()) == ["core.log", "core.log.1"]


def test_so_many_old_logs_are_kept_and_what_grew_unseen_is_kept_from_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(logs, "LOG_BYTES_MAX", 4)
    monkeypatch.setattr(logs, "CUT_BYTES_MAX", 8)
    path = tmp_path / "core.log"
    for number in range(6):
        path.write_text(f"{number}" * 10)
        cut(path)
    cut(tmp_path / "none.log")
    assert sorted(one.read_text() for one in tmp_path.iterdir()) == ["", "33333333", "44444444", "55555555"]


def test_what_was_said_last_is_found_in_a_log_that_was_cut_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(logs, "LOG_BYTES_MAX", 4)
    path = tmp_path / "core.log"
    path.write_text("what stood there before\n")
    end = LogEnd(path)
    cut(path)
    with path.open("a") as file:
        file.write("ValueError: told\n")
    assert end.last_said() == "ValueError: told"
    end.close()


def test_a_link_in_the_place_of_a_log_is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(logs, "LOG_BYTES_MAX", 4)
    (tmp_path / "mine").write_text("of another")
    (tmp_path / "core.log").symlink_to(tmp_path / "mine")
    with pytest.raises(OSError, match="symbolic"):
        cut(tmp_path / "core.log")
    assert (tmp_path / "mine").read_text() == "of another"
