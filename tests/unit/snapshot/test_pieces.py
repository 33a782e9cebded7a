"""The pieces that ask somebody: the core's loop, the kernel. Whoever answers strangely or never is named."""

import json
import os
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hardcore.model.recorder import Census, TypeCount
from hardcore.snapshot import aside, children, memory, printed, stacks, tasks
from hardcore.snapshot.subject import Haul, Tools

S = 1_000_000_000


@contextmanager
def door(path: Path, answer: bytes | None) -> Iterator[None]:
    """A control socket that says `answer` to whoever asks; None: it never says anything."""
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        listener.listen()
        over = threading.Event()

        def serve() -> None:
            talk, _ = listener.accept()
            with talk:
                talk.recv(4096)
                if answer is None:
                    over.wait(60)
                else:
                    talk.sendall(answer)

        server = threading.Thread(target=serve)
        server.start()
        try:
            yield
        finally:
            over.set()
            server.join()


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (b"", "the core's answer had no end"),
        (b'{"ok": true', "the core's answer had no end"),
        (b"hello\n", "the core's answer was not in the form known here"),
        (b'{"ok": false, "error": "no"}\n', "the core's answer was not in the form known here"),
        (b"[" * 100_000 + b"\n", "the core's answer was not in the form known here"),
    ],
)
def test_whatever_a_core_answers_is_a_reason_and_not_a_failure(
    tmp_path: Path, answer: bytes, reason: str
) -> None:
    with door(tmp_path / "door", answer):
        assert tasks.ask(tmp_path / "door", time.monotonic_ns() + 30 * S) == reason


def test_a_core_that_never_answers_is_waited_for_no_longer_than_said(tmp_path: Path) -> None:
    with door(tmp_path / "door", None):
        assert (
            tasks.ask(tmp_path / "door", time.monotonic_ns() + S // 20) == "the core did not answer in time"
        )


def test_no_door_is_a_reason(tmp_path: Path) -> None:
    said = tasks.ask(tmp_path / "door", time.monotonic_ns() + S)
    assert said == "the core could not be asked: No such file or directory"


def test_of_a_task_only_what_has_the_form_of_its_name_is_told(tmp_path: Path) -> None:
    told = (
        b'{"ok": true, "count": 2, "tasks": [7, {"name": "cmd:tx-1", "waits_at": "core/x.py:12 run",'
        b' "transaction_id": "tx-1", "account_id": "two words", "secret": "canary"}]}\n'
    )
    with door(tmp_path / "door", told):
        answer = tasks.ask(tmp_path / "door", time.monotonic_ns() + 30 * S)
    assert answer == {
        "count": 2,
        "tasks": [
            {
                "name": "cmd:tx-1",
                "waits_at": "core/x.py:12 run",
                "transaction_id": "tx-1",
                "account_id": "<masked>",
            }
        ],
    }


def test_the_kernel_sums_up_a_memory_map_in_bytes() -> None:
    told = memory.begin_rollup(os.getpid()).wait(time.monotonic_ns() + 30 * S)
    assert not isinstance(told, str), told
    assert told["Rss"] > 1 << 20


def test_a_memory_map_of_nobody_is_a_reason() -> None:
    assert isinstance(memory.read_rollup(1 << 30), str)


def test_a_look_that_hangs_is_left_behind_and_only_so_many_may_hang() -> None:
    over = threading.Event()
    hanging = [aside.Aside(lambda: over.wait(60)) for _ in range(aside.LOOKS_MAX)]
    try:
        assert hanging[0].wait(time.monotonic_ns()) == "the kernel did not answer in time"
        assert aside.Aside(lambda: 1).wait(time.monotonic_ns() + S) == "8 earlier looks hang in the kernel"
    finally:
        over.set()
    assert [one.wait(time.monotonic_ns() + 30 * S) for one in hanging] == [True] * aside.LOOKS_MAX
    assert aside.Aside(lambda: 1).wait(time.monotonic_ns() + 30 * S) == 1


def test_the_growth_is_what_lies_between_two_censuses_the_largest_first() -> None:
    before = Census(1 * S, 100, 10, 10, 1, (TypeCount("dict", 5, 500), TypeCount("list", 5, 50)))
    after = Census(
        61 * S, 900, 90, 90, 1, (TypeCount("list", 6, 60), TypeCount("dict", 9, 900), TypeCount("x", 1, 1))
    )
    told = memory.growth(before, after)
    assert (told["over_ms"], told["rss_bytes"], told["objects"]) == (60_000, 800, 80)
    assert [(one["name"], one["count"], one["size_bytes"], one["new"]) for one in told["types"]] == [
        ("dict", 4, 400, False),
        ("list", 1, 10, False),
        ("x", 1, 1, True),
    ]


def test_what_a_core_calls_its_threads_and_files_moves_no_terminal_and_names_no_folder() -> None:
    hostile = "w\x1b]0;pwned\x07\x1b[2J"
    frame = {
        "name": hostile,
        "filename": "/home/minji/site/core/x.py",
        "short_filename": None,
        "line": 3,
        "locals": [{"name": hostile, "repr": '"a"'}],
    }
    thread = {"os_thread_id": 1, "thread_name": hostile, "active": True, "owns_gil": False, "frames": [frame]}
    child = children.start(["printf", "%s", json.dumps([thread])])
    assert not isinstance(child, str), child
    haul = Haul()
    stacks.collect_stacks(haul, os.getpid(), Tools(None, None), child, time.monotonic_ns() + 30 * S)
    assert haul.missing == {}
    for data in haul.files.values():
        assert b"\x1b" not in data
        assert b"\\u001b" not in data
        assert b"minji" not in data
    assert "(core/x.py:3)" in haul.files["stacks.txt"].decode()


@pytest.mark.parametrize(
    ("fails", "told"), [(1, []), (2, "py-spy: ended with 1: Failed to get stack traces")]
)
def test_a_look_that_fails_under_a_running_process_is_tried_once_more(
    tmp_path: Path, fails: int, told: list[object] | str
) -> None:
    looks = tmp_path / "looks"
    reader = tmp_path / "py-spy"
    reader.write_text(
        f"#!/bin/sh\necho >>{looks}\n[ $(wc -l <{looks}) -gt {fails} ] && echo [] && exit\n"
        "echo Failed to get stack traces >&2\nexit 1\n"
    )
    reader.chmod(0o755)
    haul, tools = Haul(), Tools(reader, None)
    stacks.collect_stacks(
        haul, os.getpid(), tools, stacks.begin(os.getpid(), tools), time.monotonic_ns() + 30 * S
    )
    found = haul.missing.get("stacks.json") or json.loads(haul.files["stacks.json"])
    assert (found, looks.read_text()) == (told, "\n" * 2)


@pytest.mark.parametrize(
    ("printed_line", "kept"),
    [
        ('  File "/home/minji/core/x.py", line 3 in run', '  File "core/x.py", line 3 in run'),
        (
            "Current thread 0x00007f4718fedb80 (most recent call first):",
            "Current thread 0x00007f4718fedb80 (most recent call first):",
        ),
        ("Fatal Python error: Aborted", "Fatal Python error: Aborted"),
        (
            '  Binary file "/home/minji/lib/libsqlite3.so.0", at sqlite3_step+0x1c [0x7f00]',
            '  Binary file "libsqlite3.so.0", at sqlite3_step+0x1c',
        ),
        ("\x1b[2Jpassword: canary", "<masked>password: <masked>"),
        ("", ""),
    ],
)
def test_what_a_dying_core_prints_is_shown_in_the_known_form_only(printed_line: str, kept: str) -> None:
    assert printed.told(printed_line) == kept
