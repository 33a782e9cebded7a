"""What a court can judge without a process: its docket, its place, stacks, slowness, halves, ends."""

import json
import signal
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.departure import ExitCode
from core.trying import place
from core.trying.asking import sent_of
from core.trying.docket import CASES_MAX, Docket, Events, Request, Row, Unusable, read_docket
from core.trying.log import Named, Span, killer_in, named
from core.trying.place import clear_up, take_place
from core.trying.stacks import frame_of
from core.trying.verdicts import Ordeal, ended, whose_of
from core.trying.watch import Ending, How, Work, slowed
from tests.unit.core.books import closing, moving, opening, pen

IMPORT = "01234567-89ab-7def-8123-456789abcdef"
REQUEST = {"method": "POST", "path": "/api/x?y=1", "headers": [["A", "b"]], "body": "e30="}


def docket(*cases: dict[str, Any], **members: Any) -> Docket | str:
    said = {"version": 1, "limit_ms": 15_000, "cases": list(cases), **members}
    return read_docket(json.dumps(said).encode())


def test_a_docket_says_what_is_tried() -> None:
    read = docket(
        {"name": "a" * 32, "request": REQUEST},
        {"name": "b" * 32, "row": {"import": IMPORT, "ordinal": 7}},
        {"name": "log", "events": {"after": 12}},
        memory_bytes=1 << 30,
    )
    assert isinstance(read, Docket)
    assert [case.tried for case in read.cases] == [
        Request("POST", "/api/x?y=1", [("A", "b")], b"{}"),
        Row(IMPORT, 7),
        Events(12),
    ]
    assert (read.limit_ms, read.memory_bytes, read.copy_bytes_max) == (15_000, 1 << 30, 2 << 30)


@pytest.mark.parametrize(
    "members",
    [
        {"method": "POST /x HTTP/1.1\r\nA:"},
        {"method": ""},
        {"path": "x"},
        {"path": "/a b"},
        {"path": "/a\r\nX: y"},
        {"headers": [["A\r\nB", "c"]]},
        {"headers": [["A", "c\r\nB: d"]]},
        {"headers": [["A", "c\u0000"]]},
        {"headers": [["A", "b"]] * 200},
    ],
)
def test_a_request_that_could_be_two_or_none_is_kept_out_and_those_beside_it_are_tried(
    members: dict[str, Any],
) -> None:
    beside = {"name": "b" * 32, "request": REQUEST}
    read = docket({"name": "a" * 32, "request": {**REQUEST, **members}}, beside)
    assert isinstance(read, Docket)
    assert [type(case.tried) for case in read.cases] == [Unusable, Request]


@pytest.mark.parametrize("members", [{"headers": [["A"]]}, {"body": "not base64"}, {"body": None}])
def test_a_docket_of_a_wrong_shape_is_refused(members: dict[str, Any]) -> None:
    assert isinstance(docket({"name": "a" * 32, "request": {**REQUEST, **members}}), str)


def test_a_row_or_a_piece_of_the_log_that_there_can_not_be_is_kept_out() -> None:
    read = docket(
        {"name": "a", "row": {"import": "../..", "ordinal": 1}},
        {"name": "b", "row": {"import": IMPORT, "ordinal": 0}},
        {"name": "c", "events": {"after": -1}},
    )
    assert isinstance(read, Docket)
    assert {type(case.tried) for case in read.cases} == {Unusable}


@pytest.mark.parametrize(
    "case",
    [
        {"name": "../../x", "request": REQUEST},
        {"name": "a" * 32},
        {"name": "a" * 32, "request": REQUEST, "events": {"after": 1}},
        {"name": 7, "request": REQUEST},
    ],
)
def test_a_case_that_names_nothing_is_refused(case: dict[str, Any]) -> None:
    assert isinstance(docket(case), str)


def test_a_docket_out_of_its_bounds_is_refused() -> None:
    events = {"events": {"after": 0}}
    assert isinstance(docket(version=2), str)
    assert isinstance(docket(limit_ms=0), str)
    assert isinstance(docket(limit_ms=1 << 40), str)
    assert isinstance(docket(memory_bytes=0), str)
    assert isinstance(docket(copy_bytes_max=-1), str)
    assert isinstance(docket(*({"name": f"n{n}", **events} for n in range(CASES_MAX + 1))), str)
    assert isinstance(docket({"name": "n", **events}, {"name": "n", **events}), str)


@given(st.binary(max_size=200))
def test_no_bytes_make_a_docket_raise(raw: bytes) -> None:
    read_docket(raw)
    read_docket(b'{"version":1,"limit_ms":1,"cases":[' + raw + b"]}")


def test_a_request_is_sent_as_it_came_but_for_what_belongs_to_its_connection() -> None:
    headers = [
        ("Host", "127.0.0.1:3001"),
        ("Transfer-Encoding", "chunked"),
        ("Content-Length", "9"),
        ("Idempotency-Key", "k"),
    ]
    sent = sent_of(Request("POST", "/api/x?y=1", headers, b"{}"))
    head, _, body = sent.partition(b"\r\n\r\n")
    assert body == b"{}"
    assert head.split(b"\r\n") == [
        b"POST /api/x?y=1 HTTP/1.1",
        b"host: 127.0.0.1:3001",
        b"connection: close",
        b"content-length: 2",
        b"Idempotency-Key: k",
    ]
    assert Request("POST", "/", headers).key == "k"


@given(st.integers(1, 700), st.data())
def test_halves_find_the_one_event_that_kills(events: int, data: st.DataObject) -> None:
    after = data.draw(st.integers(0, events - 1))
    killer = data.draw(st.integers(after + 1, events))
    assert killer_in(Span(after, events), lambda span: span.after < killer <= span.until) == killer


def test_an_event_of_the_log_is_named_with_the_accounts_that_it_touches(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        move = moving(5, "a", "b")
        made.carry_out(opening("a"), opening("b"), move, opening("가계:식비"), closing("가계:식비"))
    assert [named(tmp_path, seq) for seq in range(1, 7)] == [
        Named("account.opened", account_ids=("a",)),
        Named("account.opened", account_ids=("b",)),
        Named("transaction.posted", move.id, ("a", "b")),
        Named("account.opened", account_ids=("가계:식비",)),
        Named("account.closed", account_ids=("가계:식비",)),
        Named(),
    ]


def test_no_event_is_named_where_none_kills_by_itself() -> None:
    assert killer_in(Span(0, 100), lambda span: span.after < 10 and span.until >= 90) is None


def dumped(*threads: tuple[str, list[tuple[str, int, str]]]) -> str:
    lines = ["Fatal Python error: Segmentation fault", ""]
    for head, frames in threads:
        lines.append(f"{head} 0x00007f0000000000 (most recent call first):")
        lines += [f'  File "{path}", line {line} in {function}' for path, line, function in frames]
        lines.append("")
    return "\n".join(lines)


MAIN = [("/usr/lib/python3/asyncio/runners.py", 9, "run"), ("/opt/x/core/trying/life.py", 1, "live")]
DECIDES = [("/usr/lib/python3/threading.py", 5, "acquire"), ("/opt/x/core/journal/batch.py", 88, "decide")]
IDLE = [("/usr/lib/python3/threading.py", 7, "wait"), ("/opt/x/core/journal/writer.py", 3, "_take")]


def test_a_death_is_placed_in_the_thread_that_died() -> None:
    text = dumped(("Thread", DECIDES), ("Current thread", [("/opt/x/core/web/door.py", 4, "stamp")]))
    assert frame_of(text, hangs=False) == "stamp (core/web/door.py:4)"


def test_silence_is_placed_with_whoever_is_at_the_book() -> None:
    assert frame_of(dumped(("Current thread", MAIN), ("Thread", DECIDES)), hangs=True) == (
        "decide (core/journal/batch.py:88)"
    )
    working = [("/opt/x/core/web/pages.py", 4, "draw")]
    assert frame_of(dumped(("Thread", IDLE), ("Current thread", working)), hangs=True) == (
        "draw (core/web/pages.py:4)"
    )


def test_a_frame_shows_nothing_of_the_machine_and_no_sign_that_cannot_be_printed() -> None:
    text = dumped(("Current thread", [("/home/me/x.py", 4, "a\x1b[2Jb")]))
    assert frame_of(text, hangs=False) == "a?[2Jb (x.py:4)"


@given(st.text(max_size=400))
def test_no_text_makes_the_reader_of_stacks_raise(text: str) -> None:
    frame_of(text, hangs=True)
    frame_of("Thread 0x1\n" + text, hangs=False)


NOTHING = Work(0, 0, frozenset("S"))


@pytest.mark.parametrize(
    ("now", "guilty"),
    [
        (Work(0, 0, frozenset("S")), True),  # it waits for something of ours
        (Work(9_000_000_000, 1_000_000_000, frozenset("RS")), True),  # it spins
        (Work(600_000_000, 9_000_000_000, frozenset("R")), True),  # it had enough of a starved machine
        (Work(100_000_000, 9_000_000_000, frozenset("R")), False),
        (Work(0, 0, frozenset("SD")), False),
        (Work(0, 0, frozenset("T")), False),
    ],
)
def test_whoever_could_not_have_answered_is_not_guilty(now: Work, *, guilty: bool) -> None:
    assert (slowed(10_000_000_000, NOTHING, now) == "") is guilty


@pytest.mark.parametrize(
    ("ending", "ordeal"),
    [
        (Ending(How.DIED, signal=signal.SIGSEGV), Ordeal.DIED),
        (Ending(How.DIED, signal=signal.SIGABRT), Ordeal.DIED),
        (Ending(How.DIED, code=0), Ordeal.DIED),
        (Ending(How.DIED, code=ExitCode.BUG), Ordeal.DIED),
        (Ending(How.DIED, signal=signal.SIGKILL), Ordeal.UNTRIED),
        (Ending(How.DIED, signal=signal.SIGTERM), Ordeal.UNTRIED),
        (Ending(How.DIED, code=ExitCode.COMMIT_FAILED), Ordeal.UNTRIED),
        (Ending(How.DIED, code=ExitCode.DISK_FULL), Ordeal.UNTRIED),
        (Ending(How.HUNG), Ordeal.HUNG),
        (Ending(How.GREW), Ordeal.GREW),
        (Ending(How.SLOW, why="the disk"), Ordeal.UNTRIED),
    ],
)
def test_only_what_came_from_inside_says_anything_of_a_case(ending: Ending, ordeal: Ordeal) -> None:
    assert ended("a", ending).ordeal is ordeal


def test_what_a_core_did_not_say_is_not_invented() -> None:
    assert whose_of({}) == {}
    told = {"fingerprint": "f", "kind": "k", "account_ids": ["a"], "transaction_id": "t"}
    assert whose_of(told) == {**told, "account_ids": ("a",)}


def test_a_place_is_kept_while_it_is_held_and_removed_once_nobody_holds_it(tmp_path: Path) -> None:
    held = take_place(tmp_path)
    assert held.path.stat().st_mode & 0o777 == 0o700
    left = tmp_path / place.TRIALS / "left"
    left.mkdir()
    (left / "ledger.db").write_bytes(b"x")
    assert clear_up(tmp_path) == 1
    assert (held.path.is_dir(), left.exists()) == (True, False)
    held.remove()
    assert list((tmp_path / place.TRIALS).iterdir()) == []


def test_what_is_no_folder_of_a_trial_is_left_alone(tmp_path: Path) -> None:
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "book").write_bytes(b"x")
    take_place(tmp_path).remove()
    (tmp_path / place.TRIALS / "link").symlink_to(precious)
    assert clear_up(tmp_path) == 0
    assert (precious / "book").read_bytes() == b"x"
