"""The guard's log: a disk that takes nothing costs lines, never the time of whoever writes them."""

import json
import os
from pathlib import Path

import pytest

from hardcore.host import logs
from hardcore.host.logs import LogFile, LogThread, place
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
