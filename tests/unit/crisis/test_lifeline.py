"""The life of a socket as a table: total, led to one core at a time, and gone on where it stopped."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardcore.crisis.lifeline import (
    LOSSES_PER_EPOCH_MAX,
    TABLE,
    Line,
    Pull,
    Tug,
    sayable,
    seq_after,
    seq_asked,
    target_after,
    when_closed,
    when_released,
)

#: Lives in which an end at a core is open or asked for.
LED = {Line.ASKING, Line.OPEN, Line.RESUMING}


def test_the_table_has_an_answer_for_everything() -> None:
    assert set(TABLE) == {(line, pull) for line in Line for pull in Pull}


def test_a_core_is_asked_only_where_no_other_end_is_open() -> None:
    for (line, _), (after, tug) in TABLE.items():
        if tug is Tug.ASK:
            assert line not in LED
        if after in LED and line not in LED:
            assert tug is Tug.ASK


def test_a_browsers_end_that_was_answered_is_never_answered_again() -> None:
    answers = {Tug.OPEN, Tug.PASS_REFUSAL, Tug.SAY_BROKEN, Tug.SAY_NOT_DONE, Tug.SAY_LATE}
    for (line, _), (_, tug) in TABLE.items():
        if tug in answers:
            assert line in {Line.WAITING, Line.ASKING}
        if tug in {Tug.END_LATER, Tug.END_RESTARTED, Tug.PASS_CLOSE, Tug.JOIN}:
            assert line not in {Line.WAITING, Line.ASKING}


def test_the_end_is_the_end() -> None:
    assert {TABLE[Line.OVER, pull] for pull in Pull} == {(Line.OVER, Tug.NOTHING)}


def test_the_death_of_a_core_ends_no_browsers_end() -> None:
    for line in LED:
        after, _ = TABLE[line, Pull.CORE_LOST]
        assert after is not Line.OVER


@pytest.mark.parametrize(
    ("line", "resumable", "losses", "pull"),
    [
        (Line.WAITING, False, 0, Pull.PASS),
        (Line.ORPHANED, True, 0, Pull.PASS),
        (Line.ORPHANED, False, 0, Pull.PASS_FOREIGN),
        (Line.ORPHANED, True, LOSSES_PER_EPOCH_MAX - 1, Pull.PASS),
        (Line.ORPHANED, True, LOSSES_PER_EPOCH_MAX, Pull.SPENT),
        (Line.WAITING, False, LOSSES_PER_EPOCH_MAX, Pull.SPENT),
    ],
)
def test_what_a_release_means(line: Line, resumable: bool, losses: int, pull: Pull) -> None:
    assert when_released(line, resumable=resumable, losses=losses) is pull


def test_a_core_that_says_it_is_leaving_did_not_mean_this_socket() -> None:
    assert {when_closed(code) for code in (1001, 1012)} == {Pull.CORE_LOST}
    assert {when_closed(code) for code in (1000, 1008, 1011, 1013, 4000)} == {Pull.CORE_CLOSED}


@pytest.mark.parametrize(
    ("target", "seen", "goes_on"),
    [
        (b"/ws", None, b"/ws"),
        (b"/ws?after=3", None, b"/ws?after=3"),
        (b"/ws", 0, b"/ws?after=0"),
        (b"/ws?", 7, b"/ws?after=7"),
        (b"/ws?after=3", 7, b"/ws?after=7"),
        (b"/ws?a=1&after=3&b=2&after=4", 7, b"/ws?a=1&b=2&after=7"),
        (b"/ws?afterwards=3", 7, b"/ws?afterwards=3&after=7"),
    ],
)
def test_a_socket_goes_on_with_its_own_question_and_what_it_has_seen(
    target: bytes, seen: int | None, goes_on: bytes
) -> None:
    assert target_after(target, seen) == goes_on


@pytest.mark.parametrize(
    ("target", "seq"),
    [
        (b"/ws", None),
        (b"/ws?after=", None),
        (b"/ws?after=x", None),
        (b"/ws?after=-1", None),
        (b"/ws?after=9999999999999999999", None),
        (b"/ws?x=1&after=12", 12),
    ],
)
def test_what_a_client_asked_for_is_a_number_or_nothing(target: bytes, seq: int | None) -> None:
    assert seq_asked(target) == seq


@pytest.mark.parametrize(
    ("seen", "frame", "after"),
    [
        (None, b'{"type":"ledger.hello","seq":5}', 5),
        (7, b'{"type":"ledger.hello","seq":5}', 7),
        (7, b'{"type":"ledger.account","seq":9}', 9),
        (7, b'{"type":"ledger.resync","seq":5}', 5),  # an older book was taken back
        (7, b'{"type":"import.progress","done":9}', 7),
        (7, b'{"seq":true}', 7),
        (7, b'{"seq":"9"}', 7),
        (7, b'["seq"]', 7),
        (7, b'{"seq":', 7),
        (7, b'\xff"seq"', 7),
    ],
)
def test_how_far_a_page_has_seen_is_read_from_what_it_was_told(
    seen: int | None, frame: bytes, after: int | None
) -> None:
    assert seq_after(seen, frame) == after


@given(st.binary(max_size=60))
def test_no_frame_of_a_core_can_end_the_reading(frame: bytes) -> None:
    seen = seq_after(3, frame + b'"seq"')
    assert isinstance(seen, int)


def test_only_codes_that_may_be_said_are_said() -> None:
    assert [sayable(code, 1000) for code in (None, 1005, 1006, 1015, 2999)] == [1000] * 5
    assert [sayable(code, 1000) for code in (1001, 1012, 3000, 4999)] == [1001, 1012, 3000, 4999]
