"""The feed's lines: what is wrong in one of them is a value, and nothing that comes in can end the reading."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardcore.crisis.feed import (
    LINE_BYTES_MAX,
    AlertedHeard,
    LineSplitter,
    PhaseHeard,
    QuarantineHeard,
    ReleaseHeard,
    ServingHeard,
    Settled,
    SuspectsHeard,
    Unreadable,
    Verdict,
    VerdictHeard,
    VerifiedHeard,
    outcomes_lines,
    parse_line,
)
from hardcore.crisis.outcomes import SETTLED_MAX, OutageBook
from hardcore.model.phases import Face


def test_each_line_of_the_wire_becomes_its_message() -> None:
    phase = (
        b'{"type": "phase", "generation": 3, "phase": "RUNNING", "state": "DEGRADED", "face": "FORWARD",'
        b' "stage": null, "since_ns": 12, "incident": null, "planned": false}'
    )
    assert parse_line(phase) == PhaseHeard(
        3, "RUNNING", "DEGRADED", Face.FORWARD, None, None, 12, planned=False
    )
    safe = phase.replace(b'"planned"', b'"safe": "DISK_FULL", "planned"')
    assert parse_line(safe) == PhaseHeard(
        3, "RUNNING", "DEGRADED", Face.FORWARD, None, None, 12, planned=False, safe="DISK_FULL"
    )
    serving = b'{"type": "serving", "generation": 3, "socket": "/run/x", "epoch": 7}'
    assert parse_line(serving) == ServingHeard(3, "/run/x", 7)
    assert parse_line(b'{"type": "suspects", "generation": 3, "keys": ["aa"]}') == SuspectsHeard(3, ("aa",))
    release = b'{"type": "release", "generation": 3, "epoch": 7, "incident": "i"}'
    assert parse_line(release) == ReleaseHeard(3, 7, "i")
    verified = b'{"type": "verified", "generation": 3, "epoch": 7, "ok": true, "seq": 12}'
    assert parse_line(verified) == VerifiedHeard(3, 7, ok=True)
    named = b'{"type": "suspects", "generation": 3, "keys": ["aa"], "account_ids": ["assets:cash"]}'
    assert parse_line(named) == SuspectsHeard(3, ("aa",), ("assets:cash",))
    verdict = b'{"type": "verdict", "generation": 3, "name": "aa", "outcome": "held", "letter": "l", "reason": "UNPROVEN"}'
    assert parse_line(verdict) == VerdictHeard(3, "aa", Verdict.HELD, "l", "UNPROVEN")
    assert isinstance(parse_line(verdict.replace(b"held", b"hung")), Unreadable)
    alerted = b'{"type": "alerted", "generation": 3, "incident": "i", "at": null, "failed": true}'
    assert parse_line(alerted) == AlertedHeard(3, "i", None, failed=True)
    at = alerted.replace(b"null", b'"2026-01-01T00:00:01.000Z"')
    assert parse_line(at) == AlertedHeard(3, "i", "2026-01-01T00:00:01.000Z", failed=False)
    assert parse_line(b'{"type": "quarantine", "generation": 3, "serial": 9}') == QuarantineHeard(3, 9)


def test_a_reason_to_read_only_that_cannot_be_a_diagnosis_is_none() -> None:
    line = '{"type": "phase", "generation": 3, "phase": "P", "state": "S", "face": "FORWARD", "safe": %s}'
    values = ('"DISK_STALLED"', '"NEW_ONE"', '"disk"', '""', "true", "7", '"<b>"', "null", f'"{"A" * 41}"')
    heard = [parse_line((line % value).encode()) for value in values]
    assert [one.safe for one in heard if isinstance(one, PhaseHeard)] == [
        "DISK_STALLED",
        "NEW_ONE",
        *[None] * 7,
    ]


def test_a_stage_that_nobody_knows_is_none() -> None:
    line = '{"type": "phase", "generation": 3, "phase": "P", "state": "S", "face": "HOLD", "stage": %s}'
    heard = [parse_line((line % stage).encode()) for stage in ("1", "4", "5", "0", "true", '"2"')]
    stages = [one.stage for one in heard if isinstance(one, PhaseHeard)]
    assert stages == [1, 4, None, None, None, None]


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"{}",
        b"[1]",
        b"\xff",
        b"{" * 100_000,
        b'{"type": "release", "generation": true, "epoch": 1}',
        b'{"type": "release", "generation": -1, "epoch": 1}',
        b'{"type": "serving", "generation": 1, "socket": 5, "epoch": 1}',
        b'{"type": "suspects", "generation": 1, "keys": 5}',
        b'{"type": "phase", "generation": 1, "phase": "R", "state": "S", "face": "SMILE"}',
        b'{"type": "verdict", "generation": 1}',
    ],
)
def test_a_line_that_is_none_of_these_is_a_value_with_a_reason(line: bytes) -> None:
    heard = parse_line(line)
    assert isinstance(heard, Unreadable)
    assert heard.why


@given(st.binary(max_size=300))
def test_no_bytes_can_break_the_reading(line: bytes) -> None:
    parse_line(line)


@given(st.lists(st.binary(max_size=20).map(lambda b: b.replace(b"\n", b"_")), max_size=8), st.integers(1, 7))
def test_lines_come_out_as_they_were_however_they_are_cut(lines: list[bytes], step: int) -> None:
    data = b"".join(line + b"\n" for line in lines)
    splitter = LineSplitter()
    found: list[bytes] = []
    for at in range(0, len(data), step):
        cut = splitter.feed(data[at : at + step])
        assert cut is not None
        found += cut
    assert found == [line for line in lines if line.strip()]


def test_a_line_without_end_is_given_up() -> None:
    assert LineSplitter().feed(b"x" * (LINE_BYTES_MAX + 1)) is None
    assert LineSplitter().feed(b"x" * (LINE_BYTES_MAX + 1) + b"\n") is None


def test_outcomes_stay_below_the_length_of_a_line_whatever_the_paths() -> None:
    requests = [Settled("DELETE", '"' * 9999, "a" * 32, "answered", 201, 10**9)] * 200
    lines = list(outcomes_lines("i" * 40, requests))
    assert sum(len(json.loads(line)["requests"]) for line in lines) == 200
    assert max(len(line) for line in lines) < LINE_BYTES_MAX


def _settled(path: str) -> Settled:
    return Settled("GET", path, None, "answered", 200, 1)


def test_an_outage_is_told_once_when_it_is_over_and_everybody_is_settled() -> None:
    book = OutageBook()
    book.begin()
    book.name("i1")
    book.meet()
    book.meet()
    book.settle(_settled("/1"))
    assert list(book.take()) == []
    book.close()
    assert list(book.take()) == []
    book.settle(_settled("/2"))
    (line,) = book.take()
    assert json.loads(line)["incident"] == "i1"
    assert [r["path"] for r in json.loads(line)["requests"]] == ["/1", "/2"]
    book.close()
    assert list(book.take()) == []


def test_an_outage_with_a_name_is_told_also_when_nobody_met_it() -> None:
    book = OutageBook()
    book.name("of an earlier one")
    book.close()
    assert list(book.take()) == []
    book.begin()
    book.name("i1")
    book.close()
    (line,) = book.take()
    assert json.loads(line)["requests"] == []


def test_the_book_has_a_last_page() -> None:
    book = OutageBook()
    for n in range(SETTLED_MAX + 3):
        book.meet()
        book.settle(_settled(str(n)))
    assert book.left_out == 3
